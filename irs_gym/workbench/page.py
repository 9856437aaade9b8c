"""`Page`: the workbench as one visitor sees it, made of Panel's widgets."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from html import escape
from typing import Any

import numpy as np
import panel as pn
from numpy.typing import NDArray

from irs_gym.radio.scene import Scene, load_scene, scene_names
from irs_gym.workbench.bench import Bench, Place, elements_range
from irs_gym.workbench.commands import training_commands
from irs_gym.workbench.figures import POLICY_COLOURS, Curve, FloorPlan
from irs_gym.workbench.handle import Point, numbers_of
from irs_gym.workbench.policy_paths import installed_policies
from irs_gym.workbench.scene_folder import SceneFolder

_LEFT = 300  # px
_RIGHT = 390
_FIELDS = 5  # numbers of a part, at the most
_WRONG = {"color": "#b30000", "font-size": "12.5px", "line-height": "1.35"}
_LOG = logging.getLogger(__name__)

# Policies are asked one at a time, for all pages.
_POLICIES = ThreadPoolExecutor(max_workers=1, thread_name_prefix="policies")


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
        self._policies = installed_policies()
        self._is_filling = False  # widgets are being told, and have nothing to tell
        self._document = pn.state.curdoc
        self.bench = Bench.of(scene)
        self.plan = FloorPlan(tuple(self._policies), self._act)
        self.curve = Curve()

        self._words = {place: _words() for place in ("scene", *_PLACES)}
        self._summary = pn.pane.HTML(width=620)
        self._make_scene()
        self._make_radio()
        self._make_part()
        self._make_policies()
        self._commands = pn.pane.HTML(width=_RIGHT)
        self.layout = self._lay_out()

        self._put(self.bench)

    # --- made once --------------------------------------------------------------------------------

    def _make_scene(self) -> None:
        self._open_list = pn.widgets.Select(name="Scene", width=200, groups=self._choices())
        self._open = pn.widgets.Button(name="Open", width=80, align="end")
        self._open.on_click(lambda _: self._open_scene())
        self._name = pn.widgets.TextInput(name="Save as", width=200)
        self._save = pn.widgets.Button(name="Save", width=80, align="end", button_type="primary")
        self._save.on_click(lambda _: self._save_scene())
        self._replace = pn.widgets.Checkbox(name="replace the file that is there")
        self._saved = pn.pane.HTML(width=_LEFT, margin=(0, 10), visible=False)

    def _make_radio(self) -> None:
        width = _LEFT - 20
        self._target = pn.widgets.EditableFloatSlider(
            name="Target (dB)", start=-90.0, end=-40.0, step=0.1, width=width
        )
        self._elements = pn.widgets.IntSlider(name="Elements on each panel", end=1, width=width)
        self._bits = pn.widgets.DiscreteSlider(
            name="Phase bits",
            options={"1": 1, "2": 2, "3": 3, "4": 4, "continuous": None},
            value=None,
            width=width,
        )
        self._target.param.watch(self._told(lambda db: self.bench.with_target(db)), "value")
        self._elements.param.watch(self._told(lambda n: self.bench.with_elements(n)), "value")
        self._bits.param.watch(self._told(lambda bits: self.bench.with_phase_bits(bits)), "value")

    def _make_part(self) -> None:
        self._part = pn.pane.HTML(width=_LEFT, margin=(0, 10))
        self._fields = [pn.widgets.FloatInput(width=86, step=0.25) for _ in range(_FIELDS)]
        for n, field in enumerate(self._fields):
            field.param.watch(self._told(partial(self._edited, n)), "value")
        self._twice = pn.widgets.Button(name="Duplicate", width=90)
        self._twice.on_click(lambda _: self._put(self.bench.duplicated()))
        self._less = pn.widgets.Button(name="Remove", width=90)
        self._less.on_click(lambda _: self._put(self.bench.removed()))

    def _make_policies(self) -> None:
        self._shown_policies = pn.widgets.CheckBoxGroup(
            options=list(self._policies), inline=True, margin=(0, 10)
        )
        self._shown_policies.param.watch(lambda _: self._ask_policies(), "value")
        self._scores = pn.pane.HTML(width=_RIGHT, margin=(0, 10))

    def _lay_out(self) -> Any:
        def title(text: str) -> Any:
            return pn.pane.HTML(f"<b>{text}</b>", margin=(8, 10, 0, 10))

        left = pn.Column(
            title("Scene"),
            pn.Row(self._open_list, self._open),
            pn.Row(self._name, self._save),
            self._replace,
            self._words["scene"],
            self._saved,
            title("Radio"),
            self._target,
            self._words["target_db"],
            self._elements,
            self._words["irs_elements"],
            self._bits,
            self._words["phase_bits"],
            title("Part"),
            self._part,
            pn.Row(*self._fields[:3]),
            pn.Row(*self._fields[3:]),
            pn.Row(self._twice, self._less),
            self._words["part"],
            width=_LEFT + 20,
        )
        middle = pn.Column(self._summary, pn.pane.Bokeh(self.plan.figure), pn.pane.HTML(_LEGEND))
        policies = (
            [title("Pretrained policies"), self._shown_policies, self._scores]
            if self._policies
            else []
        )
        right = pn.Column(
            title("Distance over the target, exactly"),
            pn.pane.Bokeh(self.curve.figure),
            *policies,
            title("Train on it"),
            self._commands,
        )

        return pn.Row(left, middle, right, styles={"font-family": "sans-serif"})

    def _choices(self) -> dict[str, dict[str, tuple[str, str]]]:
        """Scenes that can be opened: where from, name, and how they are told apart."""
        own = {name: ("folder", name) for name in self._folder.names()}
        groups = {"of the package": {name: ("package", name) for name in scene_names()}}
        return {**groups, **({"in the folder": own} if own else {})}

    # --- acts -------------------------------------------------------------------------------------

    def _act(self, act: str, at: Point) -> None:
        """What the pointer did on the floor."""
        if act == "tap":
            self._put(self.bench.taken(at).dropped())
        elif act == "panstart":
            self._put(self.bench.taken(at))
        elif act == "pan":
            self._put(self.bench.dragged(at))
        else:
            self._put(self.bench.dragged(at).dropped())

    def _told(self, act: Callable[[Any], Bench]) -> Callable[[Any], None]:
        """What to do when a widget tells of a new value."""

        def hear(event: Any) -> None:
            if not self._is_filling and event.new is not None:
                self._put(act(event.new))

        return hear

    def _edited(self, n: int, value: float) -> Bench:
        held = self.bench.held
        if held is None:
            return self.bench
        label = list(numbers_of(self.bench.scene, held))[n]
        return self.bench.edited(label, value)

    def _open_scene(self) -> None:
        home, name = self._open_list.value
        try:
            scene = load_scene(name) if home == "package" else self._folder.open(name)
            bench = Bench.of(scene)
        except (OSError, ValueError) as error:
            self._say("scene", _reason(error))
            return

        self._saved.visible = False
        self._put(bench)

    def _save_scene(self) -> None:
        try:
            file = self._folder.save(
                self.bench.shown_scene, self._name.value, is_replaced=self._replace.value
            )
        except FileExistsError as error:
            self._say("scene", f"{error}: tick the box to replace it")
            return
        except (OSError, ValueError) as error:
            self._say("scene", _reason(error))
            return

        self._say("scene", "")
        self._replace.value = False
        self._open_list.groups = self._choices()
        self._open_list.value = ("folder", file.stem)
        note = "" if self.bench.is_irs_on else ", without panels: they have 0 elements"
        self._saved.param.update(object=f"Saved as {escape(file.name)}{note}.", visible=True)
        self._tell_commands(file.stem)

    # --- shown ------------------------------------------------------------------------------------

    def _put(self, bench: Bench) -> None:
        """Take a bench in place of the one that is there, and draw what differs."""
        before = self.bench
        self.bench = bench
        is_new = bench.scene.name != before.scene.name or before is bench

        with _together(self._document):
            if is_new:
                self._fit()
            self.plan.show(bench)
            self.curve.show(bench.drawing)
            if is_new or bench.drawing is not before.drawing:
                self._summary.object = _summary_of(bench)
            self._fill(bench)
            for place in _PLACES:
                refusal = bench.refusal
                self._say(place, refusal.why if refusal and refusal.place == place else "")
            if bench.drawing is not before.drawing or is_new:
                self._clear_policies()

        if bench.grip is None and (bench.drawing is not before.drawing or before.grip is not None):
            self._ask_policies()

    def _fit(self) -> None:
        """Give figures and sliders the sizes of another scene."""
        scene = self.bench.scene
        gain = self.bench.drawing.radio_map.gain_db
        finite = gain[np.isfinite(gain)]
        _, most, step = elements_range(scene)
        self._is_filling = True
        self.plan.fit(scene)
        if finite.size:
            self._target.param.update(
                start=float(np.floor(min(finite.min(), scene.target_db))),
                end=float(np.ceil(max(finite.max(), scene.target_db))),
            )
        self._elements.param.update(end=max(most, 1), step=max(step, 1), disabled=most == 0)
        self._name.value = scene.name
        self._is_filling = False
        self._tell_commands(scene.name)

    def _fill(self, bench: Bench) -> None:
        """Tell the widgets what is so."""
        scene = bench.scene
        self._is_filling = True
        now, _, _ = elements_range(scene)
        _set(self._target, value=scene.target_db)
        _set(self._elements, value=now if bench.is_irs_on else 0)
        if scene.phase_bits not in self._bits.options.values():
            bits = {str(scene.phase_bits): scene.phase_bits}
            self._bits.options = {**bits, **self._bits.options}
        _set(self._bits, value=scene.phase_bits)

        held = bench.held
        numbers = list(numbers_of(scene, held).items()) if held else []
        for n, field in enumerate(self._fields):
            label, value = numbers[n] if n < len(numbers) else ("", None)
            _set(field, name=f"{label} (m)", value=value, visible=value is not None)
        hint = "Drag a part on the floor, or click on it to type in where it is."
        _set(self._part, object=f"<code>{held}</code>" if held else hint)
        is_listed = held is not None and held.is_listed
        _set(self._twice, visible=is_listed)
        _set(self._less, visible=is_listed)
        self._is_filling = False

    def _say(self, place: Place, why: str) -> None:
        _set(self._words[place], object=escape(why), visible=bool(why))

    def _tell_commands(self, name: str) -> None:
        file = self._folder.path / f"{name}.json"
        is_there = name in self._folder.names()
        hint = "" if is_there else "<p style='margin:4px 0'>Once it is saved:</p>"
        blocks = "".join(_block(command) for command in training_commands(file))
        self._commands.object = hint + blocks

    # --- policies ---------------------------------------------------------------------------------

    def _clear_policies(self) -> None:
        for name in self._policies:
            self.plan.show_policy(name, None, self.bench.drawing.radio_map.grid)
        self._told_scores: dict[str, str] = {}
        self._tell_scores()

    def _ask_policies(self) -> None:
        """Ask those that are ticked for their paths, beside the page."""
        scene = self.bench.shown_scene
        self._clear_policies()
        for name in self._shown_policies.value:
            self._told_scores[name] = "..."
            entry = self._policies[name]
            asked = _POLICIES.submit(lambda entry=entry: entry.load()(scene))
            asked.add_done_callback(partial(self._hear_policy, name, scene))
        self._tell_scores()

    def _hear_policy(self, name: str, scene: Scene, answer: "Future[NDArray[np.int64]]") -> None:
        """Show a path, in the page's own turn, unless the scene has changed meanwhile."""

        def show() -> None:
            if self.bench.shown_scene is not scene or name not in self._shown_policies.value:
                return
            error = answer.exception()
            if error is None:
                cells = answer.result()
                self.plan.show_policy(name, cells, self.bench.drawing.radio_map.grid)
                self._told_scores[name] = _score_of(self.bench, cells)
            else:
                self._told_scores[name] = _reason(error)
            self._tell_scores()

        if self._document is not None:
            self._document.add_next_tick_callback(show)

    def _tell_scores(self) -> None:
        path = self.bench.drawing.path
        rows = [("oracle", "black", f"{path.distance:.3f} m" if path else "no path")]
        for n, name in enumerate(self._policies):
            if name in self._told_scores:
                colour = POLICY_COLOURS[n % len(POLICY_COLOURS)]
                rows.append((name, colour, self._told_scores[name]))

        _set(
            self._scores,
            object="<br>".join(
                f"<span style='color:{colour}'>&#9473;</span> {escape(name)}: {escape(text)}"
                for name, colour, text in rows
            ),
        )


_PLACES: tuple[Place, ...] = ("target_db", "irs_elements", "phase_bits", "part")


def _words() -> Any:
    """Where is said what is wrong with a field."""
    return pn.pane.HTML("", visible=False, width=_LEFT, margin=(0, 10), styles=_WRONG)


def _together(document: Any) -> Any:
    """All changes inside go to the browser in one message."""
    return pn.io.hold(document)


def _set(widget: Any, **values: Any) -> None:
    """Set what differs: of what does not, nothing goes to the browser."""
    new = {name: value for name, value in values.items() if getattr(widget, name) != value}
    if new:
        widget.param.update(**new)


def _reason(error: BaseException) -> str:
    """What to say of an error, in one line."""
    if isinstance(error, FileNotFoundError):
        return "the file is not there any more"
    if isinstance(error, OSError):
        return f"{error.strerror or error}"
    if isinstance(error, ValueError):
        return str(error)

    _LOG.error("a policy failed", exc_info=error)
    return f"{type(error).__name__}: {error}"


def _summary_of(bench: Bench) -> str:
    drawing = bench.drawing
    path = drawing.path
    highest = drawing.highest_target_db
    share = drawing.feasible.sum() / max(1, drawing.radio_map.free.sum())
    shortest = (
        f"<b>{path.distance:.3f} m</b>"
        if path
        else f"<b style='color:#b30000'>none at {drawing.scene.target_db:.2f} dB</b>"
    )
    best = f"<b>{highest:.3f} dB</b>" if np.isfinite(highest) else "<b>none</b>"
    missed = f"<br><span style='color:#b30000'>{escape(drawing.missed)}</span>"

    return (
        f"shortest path {shortest} &ensp; highest feasible target {best} &ensp; "
        f"feasible cells <b>{100 * share:.1f} %</b>{missed if drawing.missed else ''}"
    )


def _score_of(bench: Bench, cells: NDArray[np.int64]) -> str:
    """How a policy's path compares with the oracle's."""
    from irs_gym.oracle.shortest_path import path_length

    drawing = bench.drawing
    distance = path_length(cells, drawing.radio_map.grid.cell_size)
    if tuple(cells[-1].tolist()) != drawing.goal:
        return f"does not reach the goal, after {distance:.3f} m"
    if drawing.path is None or not drawing.path.distance:
        return f"{distance:.3f} m"

    longer = distance / drawing.path.distance - 1
    return f"{distance:.3f} m, {100 * longer:+.1f} %"


def _block(command: str) -> str:
    """A command that one click selects."""
    style = (
        "user-select:all;white-space:pre-wrap;word-break:break-all;background:#f3f3f5;"
        "padding:6px 8px;border-radius:4px;font-size:12px;margin:4px 0"
    )
    return f"<pre style='{style}'>{escape(command)}</pre>"


def _sample(shape: str, text: str) -> str:
    svg = f"<svg width='22' height='14' style='vertical-align:-2px'>{shape}</svg>"
    return f"<span style='white-space:nowrap;margin-right:14px'>{svg} {text}</span>"


_LEGEND = "<div style='font-size:12.5px;max-width:640px'>" + "".join(
    _sample(shape, text)
    for shape, text in (
        ("<path d='M11 0 L18 7 L11 14 L4 7Z' fill='#ff8c00'/>", "start"),
        ("<rect x='5' y='1' width='12' height='12' fill='#d7191c'/>", "goal"),
        ("<path d='M11 1 L19 13 L3 13Z' fill='#1f1f23'/>", "access point"),
        ("<rect x='1' y='4' width='20' height='6' fill='#c51b8a'/>", "IRS panel"),
        ("<rect x='2' y='1' width='18' height='12' fill='#141418'/>", "obstacle"),
        ("<rect x='2' y='1' width='18' height='12' fill='#a8d8cd'/>", "pale: below the target"),
        ("<path d='M1 7 H21' stroke='black' stroke-width='3'/>", "shortest path"),
    )
)
