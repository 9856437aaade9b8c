"""`play_scene_set`: the greedy episodes of a policy from the starts of all scenes of a pool at
once.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.networks.map_network import first_of_best, plan_scene_set
from agents.policies.explorer_policy import Explorer
from agents.policies.map_policy import MapPolicy
from agents.policies.policy import Policy
from agents.policies.replanning import Replanner
from agents.rollout.rules import RULES
from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS, flat_cells
from irs_gym.mdp.dynamics import next_cells, permissions
from irs_gym.mdp.metrics import distance_ratio, spl
from irs_gym.mdp.task import Observation
from irs_gym.vector.many_scenes import build_many_scenes

Ints = NDArray[np.int64]
NOTHING = np.int8(-1)  # in place of an action, after the end of an episode


@dataclass(frozen=True, eq=False)
class SceneSetResults:
    """What a policy achieved from the start of each of S scenes; arrays of shape ``(S,)``.

    Attributes
    ----------
    is_success
        Whether the robot reached the goal.
    distance, oracle_distance
        Metres travelled, and of the shortest feasible path.
    actions
        int8, shape ``(S, T)``: what was done, refused moves included, and -1 after the end of an
        episode; None where that was not kept.
    """

    is_success: NDArray[np.bool_]
    distance: NDArray[np.float64]
    oracle_distance: NDArray[np.float64]
    actions: NDArray[np.int8] | None = None

    @property
    def spl(self) -> NDArray[np.float64]:
        """Success weighted by path length: 0 for a failure, else oracle distance over distance, 1
        at most.
        """
        return spl(self.is_success, self.oracle_distance, self.distance)

    @property
    def ratios(self) -> NDArray[np.float64]:
        """Distance over oracle distance of each success, NaN for a failure."""
        return distance_ratio(self.is_success, self.oracle_distance, self.distance)

    @property
    def ratio(self) -> float | None:
        """Mean of `ratios` over the successes; None without any."""
        return float(self.ratios[self.is_success].mean()) if self.is_success.any() else None


def play_scene_set(
    policy: Policy, pool: SceneSet, observation: Observation = "flat", max_steps: int | None = None
) -> SceneSetResults:
    """Greedy episodes of a policy, one in each scene, as in `IrsNavRandom-v0` from the scenes' own
    starts.

    Each scene is seen in the frame of `irs_gym.datasets.scene_set.frame_of` its own room, so that
    its episode is the same alone and among any others, large or small.

    Parameters
    ----------
    policy
        One over whole maps is asked once for each scene.
    pool
        S scenes.
    observation
        What other policies see; the patch has the environment's usual radius.
    max_steps
        Steps after which an episode ends; those of `most_steps` in the scene's frame by default.

    Raises
    ------
    ValueError
        Where the policy cannot see maps of this size.
    """
    groups = pool.by_frame()
    found = [_play(policy, framed, observation, max_steps) for _, framed in groups]
    kept = [np.asarray(each.actions) for each in found]

    # back in the order of the scenes
    is_success = np.zeros(len(pool), dtype=bool)
    distance = np.zeros(len(pool))
    actions = np.full((len(pool), max(done.shape[1] for done in kept)), NOTHING)
    for (numbers, _), each, done in zip(groups, found, kept, strict=True):
        is_success[numbers] = each.is_success
        distance[numbers] = each.distance
        actions[numbers, : done.shape[1]] = done

    return SceneSetResults(is_success, distance, pool.oracle_distance, actions)


def _play(
    policy: Policy, pool: SceneSet, observation: Observation, max_steps: int | None
) -> SceneSetResults:
    """Episodes in scenes of one frame."""
    max_steps = most_steps(pool) if max_steps is None else max_steps
    if isinstance(policy, MapPolicy):
        moves = first_of_best(plan_scene_set(policy.network, pool), axis=1)  # (S, X, Y)
        return _follow_moves(moves, pool, max_steps)

    if isinstance(policy, Explorer | Replanner):
        policy = replace(policy, shape=pool.shape)

    return roll_out_scene_set(policy, pool, observation, max_steps)


def most_steps(pool: SceneSet) -> int:
    """Steps after which a scored episode ends: max(400, 5 (X + Y)) on maps of X x Y cells.

    The 400 are the environment's, which ends its own episodes after as many on maps of any size,
    unless ``max_episode_steps`` is given to `gymnasium.make`.
    """
    return max(400, 5 * sum(pool.shape))


def roll_out_scene_set(
    policy: Policy, pool: SceneSet, observation: Observation, max_steps: int
) -> SceneSetResults:
    """Episodes of any policy step by step, one in each scene of a pool; see `play_scene_set`."""
    model = build_many_scenes(build_worlds(RandomTask(scenes=pool, observation=observation)))
    scenes = np.arange(len(pool))
    states = model.code.encode(scenes, pool.start, pool.goal)
    distance = np.zeros(len(pool))
    is_over = np.zeros(len(pool), dtype=bool)
    is_first = np.ones(len(pool), dtype=bool)
    done = np.full((len(pool), max_steps), NOTHING)  # (S, T)
    memory = None

    for step in range(max_steps):
        # Those who have arrived are asked no more, unless the policy's memory has a place for each.
        asked = scenes if memory is not None else np.flatnonzero(~is_over)
        seen = model.packing.unpack(model.observe(states[asked]))
        actions, memory = policy.predict(seen, memory, is_first[asked], deterministic=True)
        is_first[:] = False

        is_moving = ~is_over[asked]
        robots = asked[is_moving]
        moves = np.asarray(actions)[is_moving]
        outcome = model.move(states[robots], moves)

        done[robots, step] = moves
        states[robots] = outcome.states
        distance[robots] += outcome.moved
        is_over[robots] = outcome.is_terminated
        if is_over.all():
            break

    return SceneSetResults(is_over, distance, pool.oracle_distance, done)


def follow(
    logits: NDArray[np.float32], pool: SceneSet, max_steps: int | None = None
) -> SceneSetResults:
    """Follow the likeliest moves in each scene of a pool, by the rules of the environment.

    Parameters
    ----------
    logits
        Shape ``(S, 8, X, Y)``.
    pool
        S scenes.
    max_steps
        Steps after which an episode ends; those of `most_steps` by default.
    """
    max_steps = most_steps(pool) if max_steps is None else max_steps
    return _follow_moves(logits.argmax(axis=1), pool, max_steps)


def _follow_moves(moves: Ints, pool: SceneSet, max_steps: int) -> SceneSetResults:
    """Follow the move ``(S, X, Y)`` of each cell."""
    ahead, kind = _successors(moves, pool)
    moves = moves.reshape(len(pool), -1)
    scenes = np.arange(len(pool))
    cells = flat_cells(pool.start, pool.shape)  # (S,)
    goals = flat_cells(pool.goal, pool.shape)
    steps = np.zeros((len(pool), 3), dtype=np.int64)  # refused, straight, diagonal
    done = np.full((len(pool), max_steps), NOTHING)  # (S, T)

    for step in range(max_steps):
        scenes = scenes[cells[scenes] != goals[scenes]]  # who has arrived moves no more
        done[scenes, step] = moves[scenes, cells[scenes]]
        steps[scenes, kind[scenes, cells[scenes]]] += 1
        cells[scenes] = ahead[scenes, cells[scenes]]

    # Counted, not summed up, so that an optimal path is as long as the oracle's.
    distance = (steps[:, 1] + steps[:, 2] * np.sqrt(2.0)) * pool.cell_size

    return SceneSetResults(cells == goals, distance, pool.oracle_distance, done)


def _successors(moves: Ints, pool: SceneSet) -> tuple[Ints, Ints]:
    """Flat cell that a move in each cell leads to, and 0 for a refused, 1 for a straight, 2 for a
    diagonal move.

    ``moves`` has the shape ``(S, X, Y)``, both results ``(S, X * Y)``.
    """
    is_legal, _ = permissions(
        RULES.constraint, pool.free, pool.feasible, **pool.motion(slice(None))
    )  # (S, X, Y, 8)
    can = np.take_along_axis(is_legal, moves[..., None], axis=-1).reshape(len(pool), -1)
    moves = moves.reshape(len(pool), -1)

    ahead = next_cells(np.arange(moves.shape[1]), moves, can, pool.shape)
    kind = np.where(can, 1 + (MOVE_LENGTHS[moves] > 1.0), 0)

    return ahead, kind
