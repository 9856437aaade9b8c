"""`Bench`: the state of one workbench, and what each act of a user makes of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import lcm
from typing import Literal

from irs_gym.radio.scene import Scene
from irs_gym.workbench.drawing import CELL_SIZE, Drawing, draw
from irs_gym.workbench.handle import (
    Handle,
    Point,
    checked_scene,
    duplicated,
    edited,
    handle_at,
    moved,
    without,
)

SNAP = CELL_SIZE / 2  # metres: parts move by whole multiples of it
_REACH = 0.025  # of the room's longer side: how far from a mark a hand still takes it

Place = Literal["part", "target_db", "irs_elements", "phase_bits"]


@dataclass(frozen=True)
class Refusal:
    """Why something was not done, and at which field of the page that is said."""

    place: Place
    why: str


@dataclass(frozen=True)
class Grip:
    """A hand that has taken a part: the scene as it was then, where the hand was, and how far it
    has gone since, in metres.
    """

    scene: Scene
    at: Point
    by: Point = (0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Bench:
    """A scene being worked on. Every act returns another bench; one that cannot be done leaves
    scene and drawing as they were, and says why.

    Attributes
    ----------
    scene
        The scene, panels and all.
    opened
        The scene as it was opened.
    is_irs_on
        Whether its panels are there: False is 0 elements, the paper's "without IRS".
    drawing
        What is drawn of it.
    held
        The part that was taken last.
    grip
        Where the hand holds it; None where the hand is up.
    refused_by
        How far a hand has pulled the part to where it cannot be, in metres; None where it is.
    refusal
        Why the last act was not done; None where it was.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> bench = Bench.of(load_scene("paper")).taken((0.0, 0.0)).dragged((0.0, -2.1))
    >>> bench.scene.obstacles[2].center, round(bench.drawing.path.distance, 3)
    ((0.0, -2.0), 20.328)
    >>> bench.dragged((0.0, -9.0)).refusal.why
    'obstacles[2] reaches from (-2.0, -11.0, 0.0) to (2.0, -7.0, 1.3), outside the room'
    """

    scene: Scene
    opened: Scene
    is_irs_on: bool = True
    drawing: Drawing
    held: Handle | None = None
    grip: Grip | None = None
    refused_by: Point | None = None
    refusal: Refusal | None = None

    @classmethod
    def of(cls, scene: Scene) -> "Bench":
        """A bench with a scene on it; a ``ValueError`` says why it cannot be drawn."""
        return cls(scene=scene, opened=scene, drawing=draw(scene))

    @property
    def shown_scene(self) -> Scene:
        """The scene as it is drawn and saved: without panels where they have no elements."""
        return self.drawing.scene

    def why(self, place: Place) -> str:
        """Why the last act at a field of the page was refused; empty where it was not."""
        return self.refusal.why if self.refusal and self.refusal.place == place else ""

    # --- by hand ----------------------------------------------------------------------------------

    def taken(self, at: Point) -> "Bench":
        """The part at a point, taken; nothing is held where there is none."""
        room = self.scene.room
        reach = _REACH * max(room.x_max - room.x_min, room.y_max - room.y_min)
        held = handle_at(self.scene, at, reach)
        grip = Grip(self.scene, at) if held else None

        return replace(self, held=held, grip=grip, refusal=None, refused_by=None)

    def dragged(self, to: Point) -> "Bench":
        """The part that is held follows the hand, from where it was taken, in steps of `SNAP`."""
        if self.grip is None or self.held is None:
            return self

        held = self.held
        grip = self.grip
        by = _snapped(to[0] - grip.at[0]), _snapped(to[1] - grip.at[1])
        if by == grip.by:
            return self

        bench = self._tried("part", lambda: moved(grip.scene, held, by))

        return replace(bench, grip=replace(grip, by=by), refused_by=by if bench.refusal else None)

    def dropped(self) -> "Bench":
        """The hand lets go: a part that cannot be where it was pulled stays where it last could.

        Why it cannot is still said.
        """
        return replace(self, grip=None, refused_by=None)

    # --- by numbers -------------------------------------------------------------------------------

    def edited(self, label: str, value: float) -> "Bench":
        """A number of the part that is held, typed in; see `irs_gym.workbench.handle.edited`."""
        held = self.held
        if held is None:
            return self
        return self._tried("part", lambda: edited(self.scene, held, label, value))

    def with_target(self, target_db: float) -> "Bench":
        """Another target in dB."""
        return self._tried(
            "target_db", lambda: checked_scene({**self.scene.to_data(), "target_db": target_db})
        )

    def with_phase_bits(self, phase_bits: int | None) -> "Bench":
        """Another resolution of the phase shifters; None for continuous phases."""
        return self._tried(
            "phase_bits", lambda: checked_scene({**self.scene.to_data(), "phase_bits": phase_bits})
        )

    def with_elements(self, elements: int) -> "Bench":
        """So many elements on each panel; with 0 the panels are kept, but not drawn on or saved."""
        if elements == 0:
            return replace(self, is_irs_on=False)._tried("irs_elements", lambda: self.scene)
        return replace(self, is_irs_on=True)._tried(
            "irs_elements", lambda: self.scene.with_irs_elements(elements)
        )

    # --- more and fewer ---------------------------------------------------------------------------

    def duplicated(self) -> "Bench":
        """The part that is held, once more beside itself; the new one is held."""
        held = self.held
        if held is None:
            return self
        try:
            scene, copy = duplicated(self.scene, held)
        except ValueError as error:
            return replace(self, refusal=Refusal("part", str(error)))

        bench = self._tried("part", lambda: scene)
        return bench if bench.refusal else replace(bench, held=copy)

    def removed(self) -> "Bench":
        """The scene without the part that is held."""
        held = self.held
        if held is None:
            return self
        bench = self._tried("part", lambda: without(self.scene, held))
        return bench if bench.refusal else replace(bench, held=None, grip=None)

    def _tried(self, place: Place, change: Callable[[], Scene]) -> "Bench":
        """The bench with another scene on it; or as it is, with what is wrong with that one."""
        try:
            scene = change()
            shown = scene if self.is_irs_on else scene.with_irs_elements(0)
            drawing = draw(shown, self.drawing)
        except ValueError as error:
            why = str(error).removeprefix("scene: ")
            return replace(self, refusal=Refusal(place, why), refused_by=None)

        return replace(self, scene=scene, drawing=drawing, refusal=None, refused_by=None)


def _snapped(metres: float) -> float:
    return round(metres / SNAP) * SNAP


def elements_range(scene: Scene) -> tuple[int, int, int]:
    """What a slider of elements offers for a scene: the elements of its first panel, the most, and
    the step, which fills whole rows of sub-surfaces on every panel; zeros where it has no panel.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> elements_range(load_scene("paper"))
    (1200, 4800, 200)
    """
    if not scene.irs_panels:
        return 0, 0, 0

    step = lcm(*(panel.elements_per_row for panel in scene.irs_panels))
    now = scene.irs_panels[0].elements
    most = step * max(24, -(-2 * now // step))

    return now, most, step
