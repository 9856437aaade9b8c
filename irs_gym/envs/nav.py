"""`IrsNavEnv`: the single environment over one scene, a thin shell over its episodes."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import HumanRendering, RenderCollection
from numpy.typing import NDArray

from irs_gym.envs.episode import Episode, begin, episode_budget, option_names, resume
from irs_gym.grid import Cell
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    checked_options,
    checked_render_mode,
    checked_seed,
)
from irs_gym.mdp.dynamics import ACTIONS, Transition, check_task
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import Task, TaskArguments, World, build_world, shows_fields, task_of
from irs_gym.oracle.shortest_path import Path
from irs_gym.rendering.modes import with_render_mode
from irs_gym.vector.infos import Infos, budget_keys, checked_keys


class IrsNavEnv(gymnasium.Env[Any, int]):
    """A robot crosses a factory while it stays connected to its access point.

    ## Description
    The floor is a grid of cells. The radio map gives the exact expected channel gain of each,
    helped by an intelligent reflecting surface (IRS). The robot has to reach the goal over cells at
    or above the target by the shortest path; the exact optimum is known (`oracle`).

    ## Action Space
    ``Discrete(8)``: moves to a neighbouring cell, counter-clockwise from +x: E, NE, N, NW, W, SW,
    S, SE. Diagonal moves may cut corners.

    ## Observation Space
    Float32 in [-1, 1]. ``observation="dict"``:

    - ``position`` (4,): own x and y, scaled to the room, and the vector to the goal over the room's
      size;
    - ``gain_patch`` (2r+1, 2r+1): margin over the target around the robot in units of 5 dB,
      clipped; first axis along x, second along y; -1 in obstacles and outside;
    - ``irs`` (3 + N,): presence, resolution (1 - 2/L) and number of elements (1 - 2/(1 + M/1000))
      of the IRS, then the phase shift that each of the N sub-surfaces holds for the robot's cell
      (pi is 0; left out with ``irs_phases=False``).

    ``observation="flat"`` is the same packed as one Box, in the order of
    `gymnasium.spaces.flatten`. ``observation="masked"`` is a Dict of that Box as ``observation``
    and of ``action_mask`` (8,), int8, 1 where an action is not refused. ``observation="map"`` is an
    image (4, X, Y), channels first: margin, obstacle, robot, goal. ``observation="cell"`` is
    ``Discrete(X * Y)``: the robot's cell (i, j) in the room as i * Y + j, for tables.

    ``constraint="budget"`` adds what is left of the budget, as left / (1 + abs(left)): the key
    ``budget`` (1,) of the Dict, the first number of the Box, a fifth channel of the image.

    ## Rewards
    Minus the metres of the move, plus the decrease of the octile distance to the goal (the
    potential-based shaping Phi' - Phi), plus ``goal_bonus`` at the goal. The oracle's path has the
    largest undiscounted return of all that satisfy the constraint; under ``"terminate"`` this takes
    a bonus above the detour, which is checked for the task's own start.

    An agent that discounts by gamma may find another path the best, as the term is not gamma Phi' -
    Phi. At gamma = 0.98 and the defaults that is so from 10 of the 933 starts, by 2.6 % at most; in
    14 of the 1,000 test scenes of ``IrsNavRandom-v0``, from their own starts; and in long spirals
    it is best never to arrive. The page ``docs/shaping.md`` tells more.

    ## Starting State
    The scene's start, or with probability ``random_start`` a cell drawn among those from which the
    goal can be reached. ``reset(options={"start": (i, j), "goal": (i, j)})`` sets either for one
    episode.

    ## Episode End
    Terminates at the goal and, under ``constraint="terminate"``, at an attempt to enter a cell
    below the target. Truncated after 400 steps; ``gymnasium.make(..., max_episode_steps=n)``
    changes that. `python -m eval` scores agents that act in many scenes over max(400, 5 (X + Y))
    steps on maps of X x Y cells.

    A move into an obstacle or out of the room leaves the robot where it is and costs the move.
    Cells below the target: ``"refuse"`` treats them likewise; ``"allow"`` lets the robot in, with
    ``info["cost"]`` 1.0 there, and the episode is no success.

    ## Budget
    ``constraint="budget"`` lets the robot in as well, and every cell has its price, that of
    `irs_gym.cost_map` for ``cost="violation"``, ``"deficit"`` or ``"outage"``. It is paid at the
    start and with every step, for the cell that the robot is then in, refused moves included:
    ``info["cost"]``, out of ``budget``, of which ``info["budget_left"]`` is left. Where more is
    spent than there is, the episode terminates as a failure, without the goal's bonus; under
    ``on_exhausted="continue"`` it goes on, rewards stay what they are, and a success is to reach
    the goal within the budget; under ``"refuse"`` such a step leaves the robot where it is, for
    nothing but the metres of the move, and masks tell of it.

    A budget of ``(low, high)`` is drawn anew at each reset; ``reset(options={"budget": b})`` sets
    it for one episode, up to the largest of the task. The oracle, its distance, SPL and ratio are
    those of the shortest path within the budget, exact for each start and budget; starts are drawn
    among the cells that have such a path. Costs are charged in multiples of 2**-36, so that their
    sums are exact, and a budget may be overdrawn by 1e-9.

    ## Info
    The same keys at the reset and at every step, as plain numbers and arrays:

    - ``distance``: metres travelled; ``oracle_distance``: metres of the shortest feasible path from
      the start; ``distance_to_go``: likewise from here, inf where there is none;
    - ``refused``: moves refused so far; ``is_refused``: whether the last one was;
    - ``gain_db``: expected channel gain in this cell; ``margin_db``: gain over the target;
    - ``action_mask`` (8,): int8, 1 where a move is not refused;
    - ``cost``: 1.0 where the target is missed; ``is_success``: at the goal, without having missed
      the target;
    - ``spl``: success weighted by path length, 0 until there is success;
    - ``budget_left``: under a budget alone, what is left of it.

    ``infos`` may be a list of the keys that are wanted.

    ## Arguments
    Those of the signature. `irs_gym.mdp.task.Task` says what each is, but for ``infos`` and
    ``render_mode``: ``"rgb_array"`` or ``"ansi"``; `gymnasium.make` knows ``"human"``,
    ``"rgb_array_list"`` and ``"ansi_list"`` as well.

    >>> env = gymnasium.make("irs_gym:IrsNav-v0", target_db=-63.0)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(1)  # north-east
    >>> round(info["distance"], 3), round(env.unwrapped.oracle.distance, 3)
    (0.707, 21.571)

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA
    spec = PlainSpec()

    @shows_fields(Task)
    def __init__(
        self,
        *,
        render_mode: str | None = None,
        infos: Infos = "all",
        **arguments: Unpack[TaskArguments],
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self.world: World = build_world(task_of(arguments, type(self).__name__))
        self._keys = checked_keys(infos, budget_keys(self.world.rules))
        check_task(self.world)

        # Before a reset there are spaces, a map and an oracle already, but no step.
        ends = self.world.start, self.world.goal
        self._episode = Episode(self.world, *ends, self._keys, self.world.rules.least_budget)
        self._episode.is_running = False
        self.observation_space = self._episode.observer.packing.space
        self.action_space: spaces.Discrete = spaces.Discrete(ACTIONS)  # type: ignore[assignment]

    @property
    def task(self) -> Task:
        """The arguments."""
        return self.world.task

    @property
    def radio_map(self) -> Any:
        """The `RadioMap`."""
        return self.world.radio_map

    @property
    def oracle(self) -> Path:
        """The shortest feasible path of this episode: ``distance`` in metres, ``cells`` of shape
        ``(D, 2)``.
        """
        return self._episode.oracle

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) of this episode so far, refused moves left out."""
        return self._episode.path

    @property
    def distance_to_go(self) -> float:
        """Metres of the shortest feasible path from the robot's cell to the goal; inf where there
        is none.
        """
        return self._episode.distance_to_go

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused in this cell, bool ``(8,)``.

        A mask reveals one step of radio information: whether each neighbouring cell meets the
        target.
        """
        return self._episode.action_masks()

    def optimal_actions(self, cell: Cell | None = None) -> NDArray[np.int64]:
        """All actions that begin a shortest feasible path to this episode's goal, in ascending
        order.

        Parameters
        ----------
        cell
            The cell (i, j) to move from; the robot's by default.

        Returns
        -------
        int64, shape ``(n,)``; empty at the goal and where it cannot be reached. Equally short paths
        are told apart by more than the rounding of their lengths, so all that are as short are
        there.

        Raises
        ------
        ValueError
            Where ``cell`` is no cell of the map.
        """
        return self._episode.optimal_actions(cell)

    def transition_table(self) -> Transition:
        """What each action does in each cell, for this episode's goal: the table of a deterministic
        decision process.

        Returns
        -------
        A named tuple of arrays ``(X * Y, 8)`` over flat cells (those of ``observation="cell"``) and
        actions: ``next_cell``, ``reward``, ``moved`` (metres), ``is_refused``, ``cost``,
        ``is_terminated`` and ``is_at_goal``. At the goal each action stays for a reward of 0 and
        ends the episode. Cells that a robot cannot be in hold what the rules would give.
        Gymnasium's toy texts say the same as lists, ``P[s][a] = [(1.0, next_cell[s, a], reward[s,
        a], is_terminated[s, a])]``.
        """
        return self._episode.transition_table()

    def optimal_q(self, gamma: float) -> NDArray[np.float64]:
        """The optimal action values of this episode's goal and reward, exact but for the rounding
        of sums.

        Parameters
        ----------
        gamma
            Discount factor, above 0 and up to 1. The step limit is no part of the decision process.

        Returns
        -------
        float64, shape ``(X * Y, 8)`` over flat cells and actions, in metres; 0 at the goal.
        Undiscounted, -inf where no end can be reached.

        Raises
        ------
        ValueError
            Where ``gamma`` is out of its range.
        """
        return self._episode.optimal_q(gamma)

    def get_state(self) -> bytes:
        """Where the episode stands, as 58 bytes for `set_state`: for tree search, which takes moves
        back.

        Scene, start, goal, cell, metres, refusals, budget, what was spent of it, and whether the
        target was missed are in it. The path so far is not, nor the randomness of resets, nor the
        count of `gymnasium.wrappers.TimeLimit`, which is not this environment's.
        """
        return self._episode.snapshot().to_bytes()

    def set_state(self, state: bytes) -> None:
        """Go on from a state of this or of another environment with the same map and rules.

        All further observations, rewards and infos are those that followed it before; `path` begins
        at its cell.

        Raises
        ------
        ValueError
            Where the state is damaged, or of another map or other rules; the episode is then left
            as it is.
        """
        self.take_over(Snapshot.from_bytes(state))

    def take_over(self, snapshot: Snapshot, path: Sequence[Cell] = ()) -> None:
        """Go on with an episode that another environment began, with its path where it is known."""
        self._episode = resume(self.world, snapshot, self._keys, path)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``options`` may hold ``start`` and ``goal``, cells (i, j), and under a
        budget ``budget``.
        """
        super().reset(seed=checked_seed(seed))
        rules = self.world.rules
        given = checked_options(options, *option_names(rules))
        budget = episode_budget(rules, given.pop("budget", None), self.np_random)
        self._episode = begin(self.world, given, self.np_random, self._keys, budget)

        return self._episode.opening()

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; see the class for what the move does."""
        return self._episode.step(action)

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path."""
        return self._episode.render(self.render_mode)


def make_env(render_mode: str | None = None, **arguments: Any) -> gymnasium.Env[Any, int]:
    """What `gymnasium.make` calls: an `IrsNavEnv` in any render mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavEnv, **arguments), render_mode, HumanRendering, RenderCollection
    )
