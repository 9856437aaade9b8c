"""`BeliefPolicy`: the policy of `irs_gym.belief_optimum` for environments: the best of all that see
only a patch.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell, cells_at, nearest_move
from irs_gym.mdp.packing import Packing
from irs_gym.oracle.belief_optimum import BeliefNode, BeliefOptimum

Ints = NDArray[np.int64]


class Place(NamedTuple):
    """Where a robot is in its plan."""

    node: BeliefNode
    steps: int  # of its walk that are done


@dataclass(frozen=True, eq=False)
class BeliefPolicy:
    """Acts on local observations, dict or flat, in scenes of the family that it was computed for.

    Of margins it reads whether they are below 0. Its state is where it is in the plan of each
    robot.

    Attributes
    ----------
    optimum
        Of a family whose labels are whether cells are feasible.
    shape
        Frame (X, Y) that positions are scaled to: that of the family's maps.
    """

    optimum: BeliefOptimum
    shape: tuple[int, int]

    def predict(
        self,
        observation: Any,
        state: Sequence[Place] | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, tuple[Place, ...]]:
        """Actions for one observation or a batch, and the places in the plans; see
        `agents.policies.policy.Policy`.

        Raises
        ------
        ValueError
            Where what is seen is not what any scene of the family shows.
        """
        radius = self.optimum.radius
        decoded = Packing.of(observation, self.shape, radius).decode(observation)
        cells, goals = (
            cells_at(each.ravel(), self.shape).tolist() for each in (decoded.cell, decoded.goal)
        )
        patches = (decoded.margin >= 0.0).reshape(len(cells), -1)  # (n, (2r+1)**2)

        olds: list[Place | None] = [None] * len(cells) if state is None else list(state)
        if episode_start is not None:
            olds = [
                None if begins else old
                for old, begins in zip(olds, np.ravel(episode_start), strict=True)
            ]

        places = tuple(
            self._look(old, as_cell(cell, "cell"), as_cell(goal, "goal"), patch.tobytes())
            for old, cell, goal, patch in zip(olds, cells, goals, patches, strict=True)
        )
        actions = [_move(place) for place in places]

        return np.array(actions).reshape(decoded.cell.shape), places

    def _look(self, old: Place | None, cell: Cell, goal: Cell, patch: bytes) -> Place:
        """Where the robot is in its plan, after it has looked around its cell."""
        try:
            if old is None:
                return Place(self.optimum.first[cell, goal, patch], 0)

            # it has made the next step of its walk, or has arrived
            steps = min(old.steps + 1, len(old.node.walk) - 1)
            is_at_end = steps == len(old.node.walk) - 1
            if is_at_end and not old.node.is_last:
                return Place(old.node.after[patch], 0)
        except KeyError:
            raise ValueError(
                f"no scene of the family looks from the cell {cell} as what is observed"
            ) from None

        return Place(old.node, steps)


def _move(place: Place) -> int:
    """The number of the next move of a walk; 0 at its end, where nobody moves."""
    ahead = place.node.walk[place.steps : place.steps + 2]
    if len(ahead) < 2:
        return 0

    x, y = (ahead[1] - ahead[0]).tolist()
    return nearest_move(x, y)
