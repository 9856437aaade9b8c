"""Reference policies where the robot also switches the panel's configuration: the joint oracle,
never switch, greedy on the gain, and random ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from irs_gym.grid import Cell, legal_moves, neighbours
from irs_gym.mdp.codebook_rules import CodebookMaps, CodebookRules
from irs_gym.oracle.joint import joint_distance_to_go
from irs_gym.oracle.shortest_path import distance_to_go, optimal_moves

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Rule = Callable[[CodebookRules, int], Bools]
"""For one scene and goal, and a state, the actions to draw among, ``(8 + K,)``."""


@dataclass(frozen=True, eq=False)
class StatePolicy:
    """A policy that draws evenly among the actions that a rule leaves in the present state.

    It reads configuration, cell and goal from the observation, and all else from the maps of its
    environment. Where the rule leaves one action, it is deterministic; where it leaves none, the
    action is 0.
    """

    env: Any  # `IrsNavCodebookEnv`, or `IrsNavCodebookVectorEnv`
    rule: Rule
    rng: np.random.Generator
    _choices: dict[tuple[CodebookRules, int], Bools] = field(default_factory=dict, repr=False)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says.

        A draw among several actions is made even where ``deterministic`` is asked for.
        """
        maps = self.env.maps
        decoded = self.env.packing.decode(observation)
        states = decoded.configuration * maps.size + decoded.cell
        pairs = zip(states.ravel().tolist(), decoded.goal.ravel().tolist(), strict=True)
        choices = np.stack(
            [self._choice(self._rules(n, goal), here) for n, (here, goal) in enumerate(pairs)]
        )  # (n, 8 + K)

        # Draws in (0, 1], so that each choice has some weight.
        weight = choices * (1.0 - self.rng.random(choices.shape))

        return weight.argmax(axis=-1).reshape(states.shape), state

    def _rules(self, n: int, goal: int) -> CodebookRules:
        ends = self.env.ends_of(n) if hasattr(self.env, "ends_of") else self.env.ends
        i, j = divmod(goal, self.env.maps.shape[1])
        return _rules_of(self.env.maps, ends.scene, (i, j))

    def _choice(self, rules: CodebookRules, state: int) -> Bools:
        if (rules, state) not in self._choices:
            self._choices[rules, state] = self.rule(rules, state)

        return self._choices[rules, state]


@lru_cache(maxsize=256)
def _rules_of(maps: CodebookMaps, scene: int, goal: Cell) -> CodebookRules:
    return CodebookRules.of(maps, [(scene, goal)])


def _oracle(rules: CodebookRules, state: int) -> Bools:
    """The first of the best actions."""
    return _only(rules, rules.optimal_actions(state)[:1])


def _never_switch(rules: CodebookRules, state: int) -> Bools:
    """The first move of a shortest path under the present configuration alone."""
    k, cell = divmod(state, rules.maps.size)
    return _only(rules, np.flatnonzero(_moves(rules, k)[cell])[:1])


def _greedy_gain(rules: CodebookRules, state: int) -> Bools:
    """The first move of a path that is shortest where switches are free. The present configuration
    is kept as long as it allows such a move; then the panel switches into the one that gives the
    highest gain after it.
    """
    k, cell = divmod(state, rules.maps.size)
    is_best, gain_ahead = _free_switching(rules)  # (K, X * Y, 8) each
    if is_best[k, cell].any():
        return _only(rules, [is_best[k, cell].argmax()])

    gains = np.where(is_best[:, cell], gain_ahead[:, cell], -np.inf).max(axis=-1)  # (K,)

    return _only(rules, [8 + gains.argmax()] if np.isfinite(gains).any() else [])


def _only(rules: CodebookRules, actions: Any) -> Bools:
    chosen = np.zeros(rules.actions, dtype=bool)
    chosen[np.asarray(actions, dtype=np.int64)] = True
    return chosen


@lru_cache(maxsize=256)
def _moves(rules: CodebookRules, configuration: int) -> Bools:
    """Moves that begin a shortest path under one configuration, ``(X * Y, 8)``."""
    maps = rules.maps
    scene, goal = rules.pairs[0]
    motion = maps.motion(scene)
    feasible = maps.feasible[scene, configuration]
    to_go = distance_to_go(feasible, goal, maps.cell_size, **motion)
    legal = legal_moves(feasible, **motion)  # (X, Y, 8)
    is_best = optimal_moves(to_go[None], maps.cell_size, legal[None])[0]  # (8, X, Y)

    return np.asarray(np.moveaxis(is_best, 0, -1)).reshape(-1, 8)


@lru_cache(maxsize=64)
def _free_switching(rules: CodebookRules) -> tuple[Bools, NDArray[np.float64]]:
    """Moves under each configuration that begin a path that is shortest where switches are free,
    and the gain after each, ``(K, X * Y, 8)``.
    """
    maps = rules.maps
    scene, goal = rules.pairs[0]
    motion = maps.motion(scene)
    gain_db = maps.gain_db[scene]
    target_db = float(maps.target_db[scene])
    to_go = joint_distance_to_go(gain_db, target_db, goal, maps.cell_size, **motion)
    legal = legal_moves(maps.feasible[scene], **motion)  # (K, X, Y, 8)
    is_best = np.moveaxis(optimal_moves(to_go, maps.cell_size, legal), 1, -1)  # (K, X, Y, 8)
    ahead = neighbours(gain_db, -np.inf)
    shape = (maps.configurations, maps.size, 8)

    return is_best.reshape(shape), ahead.reshape(shape)


RULES: dict[str, Rule] = {
    "oracle": _oracle,
    "never_switch": _never_switch,
    "greedy_gain": _greedy_gain,
    "masked_random": lambda rules, state: rules.action_mask(np.array([state]))[0].astype(bool),
    "random": lambda rules, state: np.ones(rules.actions, dtype=bool),
}


def _maker(rule: Rule) -> Callable[[gymnasium.Env[Any, Any], int | None], Policy]:
    def make(env: gymnasium.Env[Any, Any], seed: int | None = None) -> StatePolicy:
        return StatePolicy(env.unwrapped, rule, np.random.default_rng(seed))

    return make


CODEBOOK_REFERENCES = {name: _maker(rule) for name, rule in RULES.items()}
