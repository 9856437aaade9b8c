"""`Page`: the workbench as one visitor sees it, made of Panel's widgets."""

from pathlib import Path
from typing import Any

import panel as pn

from irs_gym.radio.scene import Scene
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.curve import Curve
from irs_gym.workbench.floor_plan import FloorPlan
from irs_gym.workbench.handle import Point
from irs_gym.workbench.part_card import PartCard
from irs_gym.workbench.policy_card import PolicyCard
from irs_gym.workbench.radio_card import RadioCard
from irs_gym.workbench.scene_card import SceneCard
from irs_gym.workbench.scene_folder import SceneFolder
from irs_gym.workbench.texts import CURVE_LEGEND, PLAN_LEGEND, commands_of, summary_of
from irs_gym.workbench.widgets import CARD, set_new, title

_MIDDLE = 640  # px
_RIGHT = 350


class Page:
    """The workbench of one visitor.

    Parameters
    ----------
    scene
        What lies on it at first.
    folder
        Where scene files are opened and saved.
    """

    def __init__(self, scene: Scene, folder: SceneFolder) -> None:
        self._folder = folder
        self._document = pn.state.curdoc
        self.bench = Bench.of(scene)

        def bench() -> Bench:
            return self.bench

        self._scene = SceneCard(folder, bench, self.put, self._tell_commands)
        self._radio = RadioCard(bench, self.put)
        self._part = PartCard(bench, self.put)
        self._policies = PolicyCard(_RIGHT)
        self._plan = FloorPlan(self._policies.colours, self.act)
        self._curve = Curve()
        self._summary = pn.pane.HTML(width=_MIDDLE)
        self._commands = pn.pane.HTML(width=_RIGHT)

        left = pn.Column(self._scene.layout, self._radio.layout, self._part.layout, width=CARD)
        middle = pn.Column(
            self._summary,
            pn.pane.Bokeh(self._plan.figure),
            pn.pane.HTML(PLAN_LEGEND, width=_MIDDLE),
        )
        right = pn.Column(
            title("Distance over the target, exactly"),
            pn.pane.Bokeh(self._curve.figure),
            pn.pane.HTML(CURVE_LEGEND),
            self._policies.layout,
            title("Train on it"),
            self._commands,
        )
        self.layout: Any = pn.Row(left, middle, right, styles={"font-family": "sans-serif"})

        self._fit()
        self._show(None)

    def act(self, act: str, at: Point) -> None:
        """What the pointer does on the floor: ``"tap"``, ``"panstart"``, ``"pan"`` or
        ``"panend"``, at a point in metres.
        """
        if act == "tap":
            self.put(self.bench.taken(at).dropped())
        elif act == "panstart":
            self.put(self.bench.taken(at))
        elif act == "pan":
            self.put(self.bench.dragged(at))
        else:
            self.put(self.bench.dragged(at).dropped())

    def put(self, bench: Bench) -> None:
        """Take a bench in place of the one that is there, and draw what differs."""
        before = self.bench
        if bench is before:
            return

        self.bench = bench
        with pn.io.hold(self._document):  # all goes to the browser in one message
            if bench.opened is not before.opened:
                self._fit()
            self._show(before)

    def _fit(self) -> None:
        """Give everything the sizes of another scene."""
        self._plan.fit(self.bench.scene)
        self._scene.fit(self.bench)
        self._radio.fit(self.bench)
        self._tell_commands()

    def _show(self, before: Bench | None) -> None:
        bench = self.bench
        self._plan.show(bench)
        self._radio.show(bench)
        self._part.show(bench)
        if before is None or bench.drawing is not before.drawing:
            self._curve.show(bench.drawing)
            set_new(self._summary, object=summary_of(bench.drawing))
        self._policies.show(bench, self._plan)

    def _tell_commands(self) -> None:
        name = self._scene.name
        file = self._folder.path / f"{name}.json"
        here = Path.cwd()
        told = file.relative_to(here) if file.is_relative_to(here) else file
        set_new(self._commands, object=commands_of(told, name in self._folder.names()))
