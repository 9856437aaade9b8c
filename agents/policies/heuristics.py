"""Reference policies: random, greedy and oracle, which act on the cell that an observation tells,
and replanning.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from agents.policies.replanning import Replanner
from irs_gym.grid import MOVE_LENGTHS, Cell, legal_moves, neighbours, octile_distance
from irs_gym.mdp.dynamics import action_mask, tabulate
from irs_gym.mdp.packing import Packing
from irs_gym.mdp.task import World

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rule = Callable[[World, Cell], Bools]  # a world and a goal to the actions to draw among, (X, Y, 8)
_KEPT = 256  # worlds and goals whose choices a policy remembers


@dataclass(frozen=True, eq=False)
class CellPolicy:
    """A policy that draws evenly among the actions that a rule leaves in the robot's cell.

    It reads cell and goal from the observation (dict, flat or map), and all else from the world of
    its environment. Where the rule leaves one action, it is deterministic; where it leaves none,
    the action is 0.
    """

    world_of: Callable[[int], World]
    """Of the n-th observation of a batch; asked at each call, as resets may change it."""
    rule: Rule
    rng: np.random.Generator
    _choices: dict[tuple[World, int], Bools] = field(default_factory=dict, repr=False)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says.

        A draw among several actions has no likeliest one, and is made even where ``deterministic``
        is asked for.
        """
        packing = Packing.of(observation, self.world_of(0).radio_map.grid.shape)
        decoded = packing.decode(observation)
        pairs = zip(decoded.cell.ravel().tolist(), decoded.goal.ravel().tolist(), strict=True)
        choices = np.stack(
            [
                self._choices_for(self.world_of(n), goal)[cell]
                for n, (cell, goal) in enumerate(pairs)
            ]
        )  # (n, 8)

        # Draws in (0, 1], so that each choice has some weight.
        weight = choices * (1.0 - self.rng.random(choices.shape))

        return weight.argmax(axis=-1).reshape(decoded.cell.shape), state

    def _choices_for(self, world: World, goal: int) -> Bools:
        """Choices in each flat cell for a flat goal, shape ``(X * Y, 8)``."""
        if (world, goal) not in self._choices:
            if len(self._choices) >= _KEPT:
                self._choices.clear()

            cell = world.radio_map.grid.cell_at(goal)
            self._choices[world, goal] = self.rule(world, cell).reshape(-1, 8)

        return self._choices[world, goal]


def random(env: gymnasium.Env[Any, Any], seed: int | None = None) -> CellPolicy:
    """Any of the eight actions."""
    return _policy(env, lambda world, goal: np.ones((*world.feasible.shape, 8), dtype=bool), seed)


def masked_random(env: gymnasium.Env[Any, Any], seed: int | None = None) -> CellPolicy:
    """Any action that is not refused (`info["action_mask"]`)."""
    return _policy(
        env,
        lambda world, goal: action_mask(world).reshape(*world.feasible.shape, 8).astype(bool),
        seed,
    )


def greedy(env: gymnasium.Env[Any, Any], seed: int | None = None) -> CellPolicy:
    """The feasible move with the least length plus octile distance from its end to the goal: the
    greatest reward.
    """
    return _policy(env, RULES["greedy"], seed)


def greedy_margin(env: gymnasium.Env[Any, Any], seed: int | None = None) -> CellPolicy:
    """The feasible move with the greatest gain, among those that come nearer to the goal if there
    are any.
    """
    return _policy(env, RULES["greedy_margin"], seed)


def oracle(env: gymnasium.Env[Any, Any], seed: int | None = None) -> CellPolicy:
    """The first move of a shortest feasible path."""
    return _policy(env, RULES["oracle"], seed)


def replanning(env: gymnasium.Env[Any, Any], seed: int | None = None) -> Replanner:
    """The first move of a shortest path over what the robot has seen, the unknown taken for
    feasible.
    """
    task = env.unwrapped.task  # type: ignore[attr-defined]
    radius = None if task.observation == "map" else task.patch_radius
    shape = _world_reader(env)(0).radio_map.grid.shape
    return Replanner(shape, radius, task.corner_cutting)


REFERENCE_POLICIES: dict[str, Callable[[gymnasium.Env[Any, Any], int | None], Policy]] = {
    "oracle": oracle,
    "replanning": replanning,
    "greedy": greedy,
    "greedy_margin": greedy_margin,
    "masked_random": masked_random,
    "random": random,
}


def _policy(env: gymnasium.Env[Any, Any], rule: Rule, seed: int | None) -> CellPolicy:
    return CellPolicy(_world_reader(env), rule, np.random.default_rng(seed))


def _world_reader(env: Any) -> Callable[[int], World]:
    """The world of environment n: over many scenes, it has another one after each reset."""
    many: Callable[[int], World] | None = getattr(env.unwrapped, "world_of", None)
    return many or (lambda _: env.unwrapped.world)


def _octile(world: World, goal: Cell) -> Floats:
    """Octile distance of each cell to the goal in metres, shape ``(X, Y)``."""
    grid = world.radio_map.grid
    return (
        octile_distance(np.indices(grid.shape).transpose(1, 2, 0) - np.array(goal)) * grid.cell_size
    )


def _cheapest(world: World, to_go: Floats) -> Bools:
    """The feasible move with the least length plus distance to go from its end, as a choice of
    one.
    """
    return _only(
        -(MOVE_LENGTHS * world.radio_map.grid.cell_size + neighbours(to_go, np.inf)),
        legal_moves(world.feasible, **world.motion),
    )


def _greatest_gain(world: World, goal: Cell) -> Bools:
    is_feasible = legal_moves(world.feasible, **world.motion)
    octile = _octile(world, goal)
    is_nearer = is_feasible & (neighbours(octile, np.inf) < octile[..., None] - 1e-9)
    is_open = np.where(is_nearer.any(axis=-1, keepdims=True), is_nearer, is_feasible)

    return _only(neighbours(world.radio_map.gain_db, np.inf), is_open)


def _only(value: Floats, is_open: Bools) -> Bools:
    """The open action with the greatest value, as a choice of one; of equals the first."""
    best = np.where(is_open, value, -np.inf).argmax(axis=-1)  # (X, Y)
    return np.asarray(is_open & (np.arange(8) == best[..., None]))


# The rules that leave one action, and so need no draw.
RULES: dict[str, Rule] = {
    "oracle": lambda world, goal: _cheapest(world, tabulate(world, goal).distance_to_go),
    "greedy": lambda world, goal: _cheapest(world, _octile(world, goal)),
    "greedy_margin": _greatest_gain,
}
