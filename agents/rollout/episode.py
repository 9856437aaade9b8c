"""`roll_out`: one episode of a policy, as what it achieved; and the environment to play it in."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from agents.policies.policy import Policy, takes_masks
from irs_gym.datasets.codebook_task import CodebookTask, codebook_task_of
from irs_gym.datasets.continuous_task import ContinuousTask, continuous_task_of
from irs_gym.mdp.budget import OnExhausted, range_of
from irs_gym.mdp.metrics import distance_ratio, soft_spl
from irs_gym.mdp.task import Task, task_of

# Lengths are sums of floats: a path this much longer, in proportion, is as long as the oracle's.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class EpisodeResult:
    """What a policy achieved in one episode.

    Attributes
    ----------
    is_success
        Whether the robot reached the goal, over cells at or above the target only.
    distance, oracle_distance
        Metres travelled, and of the shortest feasible path from the same start; where the panel is
        switched, both with the costs of switches.
    spl
        Success weighted by path length: 0 for a failure, else oracle distance over distance.
    progress
        Share of the way to the goal that lies behind the robot at the end, in metres to go along
        feasible cells; 1 at the goal, 0 where it is farther away than at the start or has missed
        the target.
    refused, steps
        Numbers of refused moves and of all moves.
    total_reward
        Undiscounted.
    path
        int64, shape ``(T, 2)``: cells visited; float64 where the robot goes anywhere on the floor:
        points (x, y) in metres.
    actions
        int64, shape ``(steps,)``: what was done, refused moves included; float32 ``(steps, 2)``
        where the robot goes anywhere on the floor.
    switch_cells
        int64, shape ``(n, 2)``: where the panel was switched; none where it follows the robot.
    """

    is_success: bool
    distance: float
    oracle_distance: float
    spl: float
    progress: float
    refused: int
    steps: int
    total_reward: float
    path: NDArray[np.int64] | NDArray[np.float64]
    actions: NDArray[np.int64] | NDArray[np.float32] = field(
        default_factory=lambda: np.empty(0, np.int64)
    )
    switch_cells: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 2), np.int64))

    @property
    def ratio(self) -> float | None:
        """Distance over the oracle's; None for a failure, whose distance says nothing."""
        if not self.is_success:
            return None
        return float(distance_ratio(True, self.oracle_distance, self.distance))

    @property
    def soft_spl(self) -> float:
        """SPL with progress in place of success (Datta et al. 2020): a failure near the goal counts
        for something.
        """
        return float(soft_spl(self.progress, self.oracle_distance, self.distance))

    @property
    def is_optimal(self) -> bool:
        """Whether the robot reached the goal over a path as short as the oracle's."""
        return self.ratio is not None and self.ratio <= 1.0 + TOLERANCE


def arguments_of(task: Any) -> dict[str, Any]:
    """Keyword arguments of `gymnasium.make` for a task; the fields of any dataclass."""
    return {each.name: getattr(task, each.name) for each in fields(task)}


SceneTask = Task | CodebookTask | ContinuousTask
"""What an agent learns in one scene."""


def scene_task_of(arguments: Mapping[str, Any]) -> SceneTask:
    """Task of keyword arguments of `gymnasium.make`: with a ``codebook``, of `IrsNavCodebook-v0`;
    with a ``field``, of `IrsNavContinuous-v0`.

    Raises ``TypeError`` for an unknown name, and ``ValueError`` for a value out of its range.
    """
    task: SceneTask
    if "field" in arguments:
        task = continuous_task_of(arguments)
    elif "codebook" in arguments:
        task = codebook_task_of(arguments)
    else:
        return task_of(arguments)

    check_one_scene(task)

    return task


def check_one_scene(task: SceneTask) -> None:
    """Refuse a task of many scenes by a ``ValueError``."""
    if not isinstance(task, Task) and task.has_many_scenes:
        raise ValueError("split and scenes cannot be given here: this agent learns in one scene")


def env_id_of(task: SceneTask) -> str:
    """The environment of a task."""
    return f"irs_gym:{_IDS[type(task)]}"


_IDS: dict[type[SceneTask], str] = {
    Task: "IrsNav-v0",
    CodebookTask: "IrsNavCodebook-v0",
    ContinuousTask: "IrsNavContinuous-v0",
}


def evaluation_env(task: SceneTask) -> gymnasium.Env[Any, Any]:
    """The environment that policies are tested in: the task's, from its fixed start, with the
    least budget, which is the hardest to keep, and where a step that it cannot pay ends the episode
    though such steps may have been refused in training; a robot that is stopped stands on the
    border, though it may have been set back in training.

    Raises
    ------
    OSError
        Where a scene or map file cannot be read.
    ValueError
        Where it cannot be made; an infeasible target included.
    """
    tested: SceneTask = replace(task, random_start=False)
    if isinstance(tested, ContinuousTask):
        tested = replace(tested, on_refused="stop")
    if not isinstance(tested, CodebookTask):
        on_exhausted: OnExhausted = "continue" if tested.on_exhausted == "continue" else "terminate"
        least = None if tested.budget is None else min(range_of(tested.budget))
        tested = replace(tested, budget=least, on_exhausted=on_exhausted)

    return gymnasium.make(env_id_of(task), **arguments_of(tested))


def _misses(info: dict[str, Any]) -> bool:
    """Whether the target is missed: in this cell, or with a budget, where that is exhausted."""
    return bool(info["budget_left"] < 0 if "budget_left" in info else info["cost"] > 0)


def roll_out(
    policy: Policy,
    env: gymnasium.Env[Any, Any],
    *,
    deterministic: bool = True,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> EpisodeResult:
    """Play one episode of an environment of this package made by `gymnasium.make`, which bounds its
    length.
    """
    is_masked = takes_masks(policy)
    is_discrete = isinstance(env.action_space, spaces.Discrete)
    observation, start = env.reset(seed=seed, options=options)
    info = start
    actions: list[Any] = []
    total_reward = 0.0
    state = None
    is_over = False
    has_missed = False

    while not is_over:
        is_first = np.array([not actions])
        mask = {"action_masks": info["action_mask"]} if is_masked else {}
        action, state = policy.predict(observation, state, is_first, deterministic, **mask)
        actions.append(int(action) if is_discrete else action)
        observation, reward, is_terminated, is_truncated, info = env.step(actions[-1])
        total_reward = total_reward + float(reward)
        is_over = is_terminated or is_truncated
        has_missed = has_missed or _misses(info)

    robot: Any = env.unwrapped
    path = np.asarray(robot.path)

    return EpisodeResult(
        is_success=info["is_success"],
        distance=info["distance"],
        oracle_distance=start["oracle_distance"],
        spl=info["spl"],
        progress=0.0
        if has_missed
        else max(0.0, 1.0 - robot.distance_to_go / start["oracle_distance"]),
        # steps that led nowhere: neither a move nor a switch of the panel; or that were cut short
        refused=len(actions) - (len(path) - 1) - info.get("switches", 0)
        if is_discrete
        else info["refused"],
        steps=len(actions),
        total_reward=total_reward,
        path=path,
        actions=np.array(actions),
        switch_cells=np.reshape(getattr(robot, "switch_cells", []), (-1, 2)).astype(np.int64),
    )
