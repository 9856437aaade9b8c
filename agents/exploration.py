"""`Exploration`: an explorer learns on its own ways through unknown factories what the oracle would do there.

States are those that its own policy comes to, labels are what each move would really cost (DAgger, Ross et al. 2011).
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from agents.descent import cosine, descend
from agents.imitation import detours_of_moves
from agents.local_settings import ExplorerConfig
from agents.seen import Seen, patches_of
from irs_gym.grid import MOVES
from irs_gym.pool import Pool

Ints = NDArray[np.int64]
_LONGEST = 10.0  # cells: a longer detour counts as much as this, and so does a refusal


class Exploration:
    """Robots on their ways through scenes of a pool, and what is learned from them.

    At each update the network plans for what each robot has seen. The loss is the mean detour, in cells, of the moves
    that it would draw in the cells that the robot knows, were the rest of the map as it really is; beside that, the
    network learns which unknown cells are feasible. Then the robots follow their plans for some steps.
    """

    def __init__(self, config: ExplorerConfig, network: nn.Module, rng: np.random.Generator) -> None:
        self.config, self.network, self._rng = config, network, rng
        self._optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
        n = config.robots
        self._scenes, self._cells = np.zeros(n, dtype=np.int64), np.zeros((n, 2), dtype=np.int64)
        self._steps = np.zeros(n, dtype=np.int64)
        self._seen: Seen | None = None

    def update(self, pool: Pool, progress: float) -> tuple[int, dict[str, float]]:
        """One gradient step and the steps after it, counted in steps of robots; see `agents.map_learner.Teacher`."""
        if self._seen is None:
            self._seen = Seen.nothing(len(self._scenes), pool.shape, self.config.patch_radius)
            self._begin(pool, np.arange(len(self._scenes)))
        margin = torch.from_numpy(np.ascontiguousarray(self._seen.maps))
        goals = torch.from_numpy(pool.goal[self._scenes] @ [pool.shape[1], 1])
        guess = self.network(margin, goals, torch.from_numpy(pool.irs[self._scenes]))
        detour = self._detour(pool, margin, guess.plan.logits)
        unknown = margin.isnan()
        is_feasible = torch.from_numpy(pool.feasible[self._scenes]).to(margin)[unknown]
        errors = binary_cross_entropy_with_logits(guess.feasible[unknown], is_feasible, reduction="sum")
        error = errors / unknown.sum().clamp(min=1)  # small maps may be known as a whole
        loss = detour + self.config.guess_coef * error
        rate = cosine(self.config.learning_rate, progress)
        descend(self._optimizer, loss, rate, self.config.max_grad_norm)
        steps = int(self._rng.integers(1, 2 * self.config.n_steps))
        self._walk(pool, guess.plan.logits.detach().argmax(dim=1).numpy(), steps)
        return steps * len(self._scenes), {"detour": detour.item(), "guess_error": error.item()}

    def _detour(self, pool: Pool, margin: Tensor, logits: Tensor) -> Tensor:
        """Mean over the cells known to each robot of the detour that its drawn moves make, in cells."""
        metres = detours_of_moves(pool.distance_to_go[self._scenes], pool.cell_size)
        cells = torch.from_numpy(np.minimum(metres / pool.cell_size, _LONGEST).astype(np.float32))
        to_go = torch.from_numpy(pool.distance_to_go[self._scenes])
        is_asked = (margin >= 0) & to_go.isfinite() & (to_go > 0)
        mean_detour = (logits.softmax(dim=1) * cells).sum(dim=1)
        return mean_detour[is_asked].mean()

    def _begin(self, pool: Pool, robots: Ints) -> None:
        """Send robots on their way through scenes drawn anew, some of them from a cell drawn as well."""
        assert self._seen is not None
        self._scenes[robots] = self._rng.integers(len(pool), size=len(robots))
        self._cells[robots] = pool.start[self._scenes[robots]]
        for robot in robots[self._rng.random(len(robots)) < self.config.random_start].tolist():
            to_go = pool.distance_to_go[self._scenes[robot]]
            self._cells[robot] = self._rng.choice(np.argwhere(np.isfinite(to_go) & (to_go > 0)))
        self._steps[robots] = 0
        self._seen = self._seen.forget(robots)
        self._look(pool)

    def _walk(self, pool: Pool, moves: NDArray[np.int64], steps: int) -> None:
        """Follow plans ``(n, X, Y)``, looking around; who has begun anew waits for a plan of its own."""
        n, waits = np.arange(len(self._scenes)), np.zeros(len(self._scenes), dtype=bool)
        for _ in range(steps):
            ahead = self._cells + MOVES[moves[n, self._cells[:, 0], self._cells[:, 1]]]
            is_inside = ((ahead >= 0) & (ahead < pool.shape)).all(axis=1)
            inside = np.where(is_inside[:, None], ahead, 0)
            can = is_inside & pool.feasible[self._scenes, inside[:, 0], inside[:, 1]] & ~waits
            self._cells = np.where(can[:, None], ahead, self._cells)
            self._steps += ~waits
            self._look(pool)
            at_goal = (self._cells == pool.goal[self._scenes]).all(axis=1)
            over = np.flatnonzero(at_goal | (self._steps >= self.config.max_steps))
            if len(over):
                self._begin(pool, over)
                waits[over] = True

    def _look(self, pool: Pool) -> None:
        assert self._seen is not None
        self._seen = self._seen.look(self._cells, patches_of(pool, self._scenes, self._cells, self._seen.radius))
