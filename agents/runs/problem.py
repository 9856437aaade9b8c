"""`Problem`: what a policy has to solve, and its name in tables; the part of a task that fixes the
optimum.
"""

import re
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from agents.rollout.episode import SceneTask
from irs_gym.datasets.codebook_task import CodebookTask
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.grid import Cell
from irs_gym.mdp.budget import Budget, OnExhausted, range_of
from irs_gym.mdp.continuous_maps import FieldKind
from irs_gym.mdp.cost import CostKind, cost_map
from irs_gym.mdp.robot import Collision
from irs_gym.mdp.task import Constraint, ForeignMap, resolved
from irs_gym.radio.codebook import Codebook
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene, load_scene, scene_names

PAPER_ELEMENTS = (1200,)
_MOTION = ("field", "speed", "time_step", "goal_radius", "start", "goal")  # of continuous tasks


@dataclass(frozen=True)
class Problem:
    """The map, the target and the rules; what an agent sees and how it is rewarded are no part of
    it.

    What has no effect is None: the quantiser of continuous phases, all of the IRS where there is
    none. So problems are equal where their optimum is.
    """

    target_db: float
    scene: str | None
    """Name of a scene of the package; one of the user's own has the start of its SHA-256 added.
    None with a map.
    """
    radio_map: str | None
    """Start of the SHA-256 of a map from elsewhere."""
    cell_size: float
    irs_elements: tuple[int, ...]
    """Elements on each panel; empty without IRS."""
    phase_bits: int | None
    quantiser: Quantiser | None
    array_model: ArrayModel | None
    constraint: Constraint
    cost: CostKind | None
    budget: Budget | None
    on_exhausted: OnExhausted | None
    start: Cell | tuple[float, float] | None
    """A cell; where the robot goes anywhere on the floor, a point in metres."""
    goal: Cell | tuple[float, float] | None
    corner_cutting: bool = True
    robot_radius: float = 0.0
    collision: Collision = "centre"
    codebook: str | None = None
    """Design and size of the codebook that the robot switches in, or the start of its SHA-256; None
    where phases follow the robot.
    """
    switch_cost: float | None = None
    """Metres."""
    field: FieldKind | None = None
    """What the gain at a point is, where the robot goes anywhere on the floor; None on the grid."""
    speed: float | None = None
    """Metres a second."""
    time_step: float | None = None
    """Seconds."""
    goal_radius: float | None = None
    """Metres."""

    @property
    def label(self) -> str:
        """Target, phases, and whatever differs from the paper's: ``"-61.8 dB, 1 bit"``."""
        parts = [f"{self.target_db} dB", self._phases]
        if self.scene not in (None, "paper"):
            parts.append(f"scene {self.scene}")

        if self.irs_elements not in ((), PAPER_ELEMENTS):
            parts.append(f"M = {' + '.join(map(str, self.irs_elements))}")

        if self.budget is not None:
            parts.append(f"budget {_in_words(self.budget)} ({self.cost})")

        usual = {
            "cell_size": 0.5,
            "quantiser": "nearest",
            "array_model": "far_field",
            "constraint": "budget" if self.budget is not None else "refuse",
            "on_exhausted": "terminate",
            "robot_radius": 0.0,
            "collision": "centre",
        }
        for name, value in usual.items():
            if getattr(self, name) not in (value, None) and not (
                name == "cell_size" and self.radio_map
            ):
                parts.append(f"{name.replace('_', ' ')} {getattr(self, name)}")

        if not self.corner_cutting:
            parts.append("no corner cutting")

        parts += [
            f"{name} {getattr(self, name)}" for name in ("start", "goal") if getattr(self, name)
        ]
        if self.codebook is not None:
            parts += [f"codebook {self.codebook}", f"{self.switch_cost:g} m a switch"]

        if self.field is not None:
            parts.append(f"anywhere, field {self.field}")
            usual_motion = {"speed": 1.0, "time_step": 0.5, "goal_radius": 0.25}
            parts += [
                f"{name.replace('_', ' ')} {getattr(self, name):g}"
                for name, value in usual_motion.items()
                if getattr(self, name) != value
            ]

        return ", ".join(parts)

    @property
    def slug(self) -> str:
        """The label as a part of file names: ``"61.8dB-1-bit"``."""
        words = self.label.replace(" dB", "dB").replace(",", "")
        return re.sub(r"[^A-Za-z0-9.]+", "-", words).strip("-")

    @property
    def order(self) -> tuple[int, float, str]:
        """Sorts without IRS first, then from coarse to continuous phases, then from low to high
        targets.
        """
        resolution = (self.phase_bits or 99) if self.irs_elements else 0
        return resolution, self.target_db, self.label

    @property
    def _phases(self) -> str:
        if self.radio_map:
            return f"map {self.radio_map}"
        if not self.irs_elements:
            return "without IRS"
        return "continuous" if self.phase_bits is None else f"{self.phase_bits} bit"


def problem_of(task: SceneTask) -> Problem:
    """The problem of a task.

    Raises
    ------
    OSError
        Where a scene or map file cannot be read.
    ValueError
        Where one is damaged, or the elements do not fit the panels.
    """
    if isinstance(task, CodebookTask):
        whole_map = problem_of(task.one_scene)
        return replace(
            whole_map, codebook=_codebook_name(task.codebook), switch_cost=task.switch_cost
        )

    if isinstance(task, ContinuousTask):
        motion = {name: getattr(task, name) for name in _MOTION}
        return replace(problem_of(task.one_scene()), **motion)

    whole = resolved(task)
    task = whole.arguments
    radio_map = None
    scene = None
    elements: tuple[int, ...] = ()
    if isinstance(whole.radio, ForeignMap):
        given = whole.radio.radio_map
        cells = repr((given.grid.origin, given.grid.cell_size, given.gain_db.shape)).encode()
        # a map with free cells that receive nothing is another one; all others keep the digest they
        # had
        has_silence = not np.array_equal(given.free, np.isfinite(given.gain_db))
        silence = given.free.tobytes() if has_silence else b""
        outage = _outage(given, whole.target_db) if task.cost == "outage" else b""
        radio_map = _digest(cells + given.gain_db.tobytes() + silence + outage)
    else:
        scene = _scene_name(whole.radio.scene)
        elements = tuple(panel.elements for panel in whole.radio.built_scene.irs_panels)

    has_irs = bool(elements)
    has_budget = task.budget is not None

    return Problem(
        target_db=whole.target_db,
        scene=scene,
        radio_map=radio_map,
        cell_size=task.cell_size,
        irs_elements=elements,
        phase_bits=task.phase_bits if has_irs else None,
        quantiser=task.quantiser if has_irs and task.phase_bits is not None else None,
        array_model=task.array_model if has_irs else None,
        constraint=task.constraint,
        cost=task.cost if has_budget else None,
        budget=task.budget,
        on_exhausted=task.on_exhausted if has_budget else None,
        start=task.start,
        goal=task.goal,
        **asdict(task.rules.robot),
    )


def _outage(radio_map: RadioMap, target_db: float) -> bytes:
    """What fading does to the optimum, where outages are paid for."""
    return cost_map(radio_map, target_db, "outage").tobytes()


def _in_words(budget: Budget) -> str:
    return " to ".join(f"{each:g}" for each in dict.fromkeys(range_of(budget)))


def _scene_name(scene: Scene) -> str:
    """Name of the scene, whatever it says of target and resolution: a problem tells these apart."""
    if scene.name in scene_names() and _place(scene) == _place(load_scene(scene.name)):
        return scene.name
    return f"{scene.name[:60]}-{_digest(_place(scene).encode())}"


def _codebook_name(codebook: Any) -> str:
    """Design and size, or a name that tells what is made from all others."""
    if isinstance(codebook, tuple):
        return " ".join(map(str, codebook))

    made = codebook if isinstance(codebook, Codebook) else Codebook.load(codebook)

    return f"{made.size}-{_digest(made.phase_shifts.tobytes())}"


def _place(scene: Scene) -> str:
    return scene.model_dump_json(exclude={"target_db", "phase_bits"})


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()[:8]
