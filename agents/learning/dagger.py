"""`Dagger`: an explorer learns on its own ways through unknown factories what the oracle would do
there.

States are those that its own policy comes to, labels are what each move would really cost (DAgger,
Ross et al. 2011).
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, pad

from agents.learning.local_configs import ExplorerConfig
from agents.learning.optim import cosine, device_of, gradient_step
from agents.learning.robot_batch import RobotBatch
from agents.networks.planner import neighbours
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS

# Cells: a longer detour counts as much as this, and so does a refusal.
_LONGEST = 10.0


class Dagger:
    """Robots on their ways through scenes of a pool, and what is learned from them.

    At each update the network plans for what each robot has seen. The loss is the mean detour, in
    cells, of the moves that it would draw in the cells that the robot sees, were the rest of the
    map as it really is; beside that, the network learns which unknown cells are feasible. Then the
    robots follow their plans for some steps.
    """

    def __init__(
        self, config: ExplorerConfig, network: nn.Module, rng: np.random.Generator
    ) -> None:
        self.config = config
        self.device = device_of(config.device)
        self.network = network.to(self.device)
        self._rng = rng
        self._optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
        self._robots: RobotBatch | None = None  # under way from the first update on

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """One gradient step and the steps after it, counted in steps of robots; see
        `agents.learning.map_learner.Teacher`.
        """
        config = self.config
        if self._robots is None:
            self._robots = RobotBatch(config.terms, pool, self._rng, self.device)

        robots = self._robots
        margin, goals = robots.known(pool)
        guess = self.network(margin, goals)

        # What the map is really like, to go by and, where a robot has not looked, to guess.
        is_feasible, to_go = robots.truth(pool)  # (n, X, Y)
        detour = _mean_detour(guess.plan.logits, to_go, (margin >= 0) & robots.in_view())
        unknown = margin.isnan()
        errors = binary_cross_entropy_with_logits(
            guess.feasible[unknown], is_feasible[unknown].to(margin), reduction="sum"
        )
        error = errors / unknown.sum().clamp(min=1)  # small maps may be known as a whole

        loss = detour + config.guess_coef * error
        rate = cosine(config.learning_rate, progress)
        gradient_step(self._optimizer, loss, rate, config.max_grad_norm)

        # On to the states that its own plans lead to.
        steps = int(self._rng.integers(1, 2 * config.n_steps))
        moves = guess.plan.logits.detach().argmax(dim=1).to(torch.uint8)  # (n, X, Y)
        _walk(robots, pool, moves.cpu().numpy(), steps)

        return steps * config.robots, {"detour": detour.item(), "guess_error": error.item()}


def _mean_detour(logits: Tensor, to_go: Tensor, is_asked: Tensor) -> Tensor:
    """Mean over the cells asked for, bool ``(n, X, Y)``, of the detour that moves drawn there make,
    in cells.
    """
    cells = _detours(to_go).clamp(max=_LONGEST)  # (n, 8, X, Y)
    mean_detour = (logits.softmax(dim=1) * cells).sum(dim=1)  # (n, X, Y)

    # No move from the goal, nor from where it cannot be reached, is better than another.
    return mean_detour[is_asked & to_go.isfinite() & (to_go > 0)].mean()


def _detours(to_go: Tensor) -> Tensor:
    """How much longer than the shortest a way becomes with each move, ``(n, 8, X, Y)``, for
    distances to go ``(n, X, Y)`` in cells: as `irs_gym.oracle.shortest_path.detours_of_moves`.
    """
    ahead = torch.stack(neighbours(pad(to_go, (1, 1, 1, 1), value=torch.inf)), dim=1)
    lengths = torch.tensor(MOVE_LENGTHS).to(to_go)[:, None, None]

    return ahead + lengths - to_go.nan_to_num(posinf=-torch.inf)[:, None]


def _walk(robots: RobotBatch, pool: SceneSet, moves: NDArray[np.uint8], steps: int) -> None:
    """Follow plans ``(n, X, Y)``, looking around; who has begun anew waits for a plan of its
    own.
    """
    n = np.arange(len(moves))
    waits = np.zeros(len(moves), dtype=bool)

    for _ in range(steps):
        i, j = robots.cells.T
        waits |= robots.move(pool, moves[n, i, j].astype(np.int64), waits).is_over
