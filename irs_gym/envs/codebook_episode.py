"""`CodebookEpisode`: one robot on its way, which also switches the panel's configuration."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell
from irs_gym.mdp.action_values import optimal_q
from irs_gym.mdp.checks import checked_action
from irs_gym.mdp.codebook_rules import CodebookMaps, CodebookRules, Ends, configuration_world
from irs_gym.mdp.dynamics import ACTIONS, Transition
from irs_gym.mdp.metrics import spl
from irs_gym.mdp.path_history import cells_of
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World, is_integer
from irs_gym.oracle.joint import JointPath, joint_shortest_path
from irs_gym.rendering.codebook_view import codebook_picture
from irs_gym.vector.codebook_infos import CODEBOOK_KEYS
from irs_gym.vector.infos import KEYS

_KEPT = 2**18  # entries of states and actions that an environment remembers


class CodebookEpisode:
    """What has become of a robot and a panel since the reset.

    A state is a configuration and a cell; see `irs_gym.mdp.codebook_rules.CodebookRules`.
    """

    def __init__(
        self, maps: CodebookMaps, ends: Ends, keys: Sequence[str] = (*KEYS, *CODEBOOK_KEYS)
    ) -> None:
        """Begin between two ends that can be joined; ``keys``: those of the infos."""
        self.maps = maps
        self.ends = ends
        self.rules = _rules_for(maps, ends.scene, ends.goal)
        self._lookup = _Lookup.of(self.rules)
        self.is_running = True
        self._unwanted = [key for key in (*KEYS, *CODEBOOK_KEYS) if key not in keys]
        self._state: int = self.rules.state(0, ends.configuration, self._flat(ends.start))
        self._states = [self._state]
        self._oracle_distance = self._lookup.facts(self._state)[0]
        self._distance = 0.0
        self._metres = 0.0
        self._switches = 0
        self._refused = 0
        self._has_violated = False

    def _flat(self, cell: Cell) -> int:
        return cell[0] * self.maps.shape[1] + cell[1]

    @property
    def world(self) -> World:
        """The world of `IrsNav-v0` under the present configuration."""
        return configuration_world(self.maps, self.ends.scene, self.configuration)

    @property
    def configuration(self) -> int:
        """Number of the present configuration."""
        return self._state // self.maps.size

    @property
    def cell(self) -> Cell:
        """Where the robot is."""
        return divmod(self._state % self.maps.size, self.maps.shape[1])

    @property
    def states(self) -> list[int]:
        """State after each step so far, the first one in front."""
        return list(self._states)

    @property
    def oracle(self) -> JointPath:
        """The path of least metres and switches together, from the episode's beginning."""
        return joint_path(self.maps, self.ends)

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) so far, refused actions and switches left out."""
        return cells_of(np.array(self._states), self.maps.shape)

    @property
    def distance_to_go(self) -> float:
        """Metres from here to the goal, switches included; inf where it cannot be reached."""
        return self._lookup.facts(self._state)[0]

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused here, bool ``(8 + K,)``."""
        return self._lookup.mask(self._state).astype(bool)

    def optimal_actions(self, cell: Any = None, configuration: Any = None) -> NDArray[np.int64]:
        """See `irs_gym.envs.codebook_nav.IrsNavCodebookEnv.optimal_actions`."""
        i, j = self.cell if cell is None else as_cell(cell, "cell")
        present = self.configuration if configuration is None else configuration
        if not (0 <= i < self.maps.shape[0] and 0 <= j < self.maps.shape[1]):
            raise ValueError(f"cell={(i, j)} lies off the map of {self.maps.shape} cells")
        if not is_integer(present) or not 0 <= present < self.maps.configurations:
            most = self.maps.configurations - 1
            raise ValueError(f"configuration={present!r} must be a number from 0 to {most}")

        return self.rules.optimal_actions(self.rules.state(0, int(present), self._flat((i, j))))

    def transition_table(self) -> Transition:
        """See `irs_gym.envs.codebook_nav.IrsNavCodebookEnv.transition_table`."""
        return self.rules.table()

    def optimal_q(self, gamma: float) -> NDArray[np.float64]:
        """See `irs_gym.envs.codebook_nav.IrsNavCodebookEnv.optimal_q`."""
        return optimal_q(self.transition_table(), gamma)

    def snapshot(self) -> Snapshot:
        """Where the episode stands."""
        return Snapshot(
            rules=self.maps.fingerprint,
            scene=self.ends.scene,
            start=int(self.rules.state(0, self.ends.configuration, self._flat(self.ends.start))),
            goal=self._flat(self.ends.goal),
            cell=self._state,
            distance=self._distance,
            budget=0.0,
            budget_left=0.0,
            refused=self._refused,
            has_violated=self._has_violated,
            is_running=self.is_running,
            switches=self._switches,
            metres=self._metres,
        )

    def opening(self) -> tuple[Any, dict[str, Any]]:
        """What a reset returns: the first observation and its info."""
        return self._lookup.observe(self._state), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move or switch once; returns what an environment's step does."""
        if not self.is_running:
            raise ResetNeeded(
                "the episode has ended, or none has begun: call reset() before step()"
            )

        number = checked_action(action, self.rules.actions)
        outcome = self._lookup.outcome(self._state, number)
        state, reward, moved, is_refused, cost, is_terminated, is_at_goal = outcome
        is_switch = number >= ACTIONS and not is_refused

        self._states.append(state)
        self._state = state
        self._distance += moved
        self._metres += 0.0 if is_switch else moved
        self._switches += is_switch
        self._refused += is_refused
        self._has_violated = self._has_violated or cost > 0
        self.is_running = not is_terminated
        info = self._info(is_refused, cost, is_at_goal and not self._has_violated)

        return self._lookup.observe(state), reward, is_terminated, False, info

    def render(self, mode: str | None) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the present configuration's map, with the robot's
        and the oracle's path and where each switched; None without a mode.
        """
        if mode is None:
            return None
        return codebook_picture(mode, self.maps, self.ends, self.oracle, np.array(self._states))

    def _info(
        self, is_refused: bool = False, cost: float = 0.0, is_success: bool = False
    ) -> dict[str, Any]:
        distance_to_go, gain_db, margin_db = self._lookup.facts(self._state)
        info = {
            "distance": self._distance,
            "refused": self._refused,
            "distance_to_go": distance_to_go,
            "gain_db": gain_db,
            "margin_db": margin_db,
            "action_mask": self._lookup.mask(self._state).copy(),
            "is_refused": is_refused,
            "cost": cost,
            "is_success": is_success,
            "spl": float(spl(True, self._oracle_distance, self._distance)) if is_success else 0.0,
            "oracle_distance": self._oracle_distance,
            "configuration": self.configuration,
            "switches": self._switches,
            "metres": self._metres,
        }
        for key in self._unwanted:
            del info[key]

        return info


def resume(
    maps: CodebookMaps, snapshot: Snapshot, keys: Sequence[str], states: Sequence[int] = ()
) -> CodebookEpisode:
    """The episode of a snapshot, with its states so far where they are known.

    Raises ``ValueError`` for a snapshot of other maps or other rules.
    """
    if snapshot.rules != maps.fingerprint or snapshot.scene >= len(maps):
        raise ValueError(
            "state is of another task: its maps or its rules differ from those of this environment"
        )

    configuration, start = divmod(snapshot.start, maps.size)
    free = maps.free[snapshot.scene].ravel()
    is_state = snapshot.cell < maps.configurations * maps.size and free[snapshot.cell % maps.size]
    if not is_state or configuration >= maps.configurations:
        raise ValueError("state tells a cell that a robot cannot be in")

    cells = [divmod(flat, maps.shape[1]) for flat in (start, snapshot.goal)]
    ends = Ends(snapshot.scene, configuration, *cells)
    episode = CodebookEpisode(maps, ends, keys)
    episode._state = snapshot.cell
    episode._states = [int(each) for each in states] or [snapshot.cell]
    episode._distance = snapshot.distance
    episode._metres = snapshot.metres or 0.0
    episode._switches = snapshot.switches or 0
    episode._refused = snapshot.refused
    episode._has_violated = snapshot.has_violated
    episode.is_running = snapshot.is_running

    return episode


@lru_cache(maxsize=64)
def joint_path(maps: CodebookMaps, ends: Ends) -> JointPath:
    """The path of least metres and switches together between two ends; kept."""
    return joint_shortest_path(
        maps.gain_db[ends.scene],
        float(maps.target_db[ends.scene]),
        ends.start,
        ends.goal,
        maps.cell_size,
        maps.switch_cost,
        first=ends.configuration,
        **maps.motion(ends.scene),
    )


@lru_cache(maxsize=64)
def _rules_for(maps: CodebookMaps, scene: int, goal: Cell) -> CodebookRules:
    return CodebookRules(maps, np.array([scene]), np.array([goal]))


class _Lookup:
    """What there is to say of single states, worked out as it is asked for.

    Robots are in the same states again and again, so the latest are kept.
    """

    def __init__(self, rules: CodebookRules) -> None:
        kept = max(1, _KEPT // rules.actions)
        actions = np.arange(rules.actions)

        def outcomes(state: int) -> tuple[list[Any], NDArray[np.int8]]:
            step = rules.transition(np.array(state), actions)
            rows = zip(
                *(np.broadcast_to(each, actions.shape).tolist() for each in step), strict=True
            )
            return list(rows), (~step.is_refused).astype(np.int8)

        def facts(state: int) -> tuple[float, float, float]:
            here = np.array([state])
            each = (rules.distance_to_go(here), rules.gain_db(here), rules.margin_db(here))
            return tuple(float(value[0]) for value in each)  # type: ignore[return-value]

        def parts(state: int) -> Any:
            return rules.observe(np.array([state]))

        self._outcomes = lru_cache(maxsize=kept)(outcomes)
        self._parts = lru_cache(maxsize=kept)(parts)
        self._rules = rules
        self._packing = rules.packing
        self.facts: Callable[[int], tuple[float, float, float]] = lru_cache(maxsize=kept)(facts)
        """Metres to go, gain and margin in dB."""

    def __reduce__(self) -> Any:
        return _Lookup.of, (self._rules,)

    @staticmethod
    @lru_cache(maxsize=8)
    def of(rules: CodebookRules) -> "_Lookup":
        """That of the rules, shared by the episodes that have them."""
        return _Lookup(rules)

    def outcome(self, state: int, action: int) -> Any:
        """The fields of a `Transition`."""
        return self._outcomes(state)[0][action]

    def mask(self, state: int) -> NDArray[np.int8]:
        """1 where an action is not refused, not to be written to."""
        return self._outcomes(state)[1]

    def observe(self, state: int) -> Any:
        """Observation in memory of its own."""
        if self._packing.observation == "cell":
            return state
        return self._packing.unpack(tuple(part[0].copy() for part in self._parts(state)))
