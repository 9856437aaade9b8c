"""`PolicyCard`: which policies' paths are drawn beside the oracle's, and how long they are."""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import panel as pn
from numpy.typing import NDArray

from irs_gym.radio.scene import Scene
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.floor_plan import POLICY_COLOURS, FloorPlan
from irs_gym.workbench.policy_paths import installed_policies
from irs_gym.workbench.texts import reason_of, score_of, scores_of
from irs_gym.workbench.widgets import set_new, title

# Policies are asked one at a time, for all pages.
_ASKED = ThreadPoolExecutor(max_workers=1, thread_name_prefix="policies")


class PolicyCard:
    """Policies to tick. They are asked beside the page, each time the hand is up; what they say of
    a scene that has changed meanwhile is dropped.

    Parameters
    ----------
    width
        In px.
    """

    def __init__(self, width: int) -> None:
        self._entries = installed_policies()
        self._colours = {
            name: POLICY_COLOURS[n % len(POLICY_COLOURS)] for n, name in enumerate(self._entries)
        }
        self._document = pn.state.curdoc
        self._bench: Bench | None = None
        self._scores: dict[str, str] = {}
        self._plan: FloorPlan | None = None

        self._ticked = pn.widgets.CheckBoxGroup(
            options=list(self._entries), inline=True, margin=(0, 10)
        )
        self._ticked.param.watch(lambda _: self._ask(), "value")
        self._table = pn.pane.HTML(width=width, margin=(0, 10))
        self.layout = pn.Column(
            title("Pretrained policies"), self._ticked, self._table, visible=bool(self._entries)
        )

    @property
    def colours(self) -> dict[str, str]:
        """The colour of each policy's path."""
        return self._colours

    def show(self, bench: Bench, plan: FloorPlan) -> None:
        """Ask those that are ticked for their paths, once the hand is up; take away old ones."""
        is_same = self._bench is not None and self._bench.drawing is bench.drawing
        was_up = self._bench is not None and self._bench.grip is None
        self._plan = plan
        self._bench = bench
        if not is_same:
            self._clear()
        if bench.grip is None and not (is_same and was_up):
            self._ask()

    def _clear(self) -> None:
        if self._bench is None or self._plan is None:
            return
        for name in self._entries:
            self._plan.show_policy(name, None, self._bench.drawing.radio_map.grid)
        self._scores = {}
        self._tell()

    def _ask(self) -> None:
        if self._bench is None:
            return
        self._clear()
        scene = self._bench.shown_scene
        for name in self._ticked.value:
            self._scores[name] = "..."
            asked = _ASKED.submit(self._path, name, scene)
            asked.add_done_callback(partial(self._hear, name, scene))
        self._tell()

    def _path(self, name: str, scene: Scene) -> NDArray[np.int64]:
        """Cells ``(D, 2)`` of a policy's path."""
        path: NDArray[np.int64] = self._entries[name].load()(scene)
        return path

    def _hear(self, name: str, scene: Scene, answer: "Future[NDArray[np.int64]]") -> None:
        # in the page's own turn
        if self._document is not None:
            self._document.add_next_tick_callback(partial(self._take, name, scene, answer))

    def _take(self, name: str, scene: Scene, answer: Any) -> None:
        bench = self._bench
        is_asked = bench is not None and bench.shown_scene is scene and name in self._ticked.value
        if bench is None or self._plan is None or not is_asked:
            return

        error = answer.exception()
        if error is None:
            cells = answer.result()
            self._plan.show_policy(name, cells, bench.drawing.radio_map.grid)
            self._scores[name] = score_of(bench, cells)
        else:
            self._scores[name] = reason_of(error)
        self._tell()

    def _tell(self) -> None:
        if self._bench is not None:
            set_new(self._table, object=scores_of(self._bench, self._scores, self._colours))
