"""`Expected`: what runs under a bound on the expected cost achieve, beside the hull of all
policies; `expectation`: of one mixture.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.runs.problem import Problem
from agents.single.mixture import Mixture
from agents.single.priced_vec_env import play
from eval.estimates import estimate_as_json, finite
from eval.scoreboard.results import Result
from eval.statistics import estimate, share
from irs_gym.mdp.cost import cost_map
from irs_gym.mdp.task import Task, build_world
from irs_gym.oracle.pareto_front import pareto_front

_ROUNDING = 1e-6  # of a bound, by the linear program


@dataclass(frozen=True, eq=False)
class Expected:
    """The runs on one problem, one or more, which differ in the seed.

    Attributes
    ----------
    results
        Of the runs.
    bound
        On the expected cost.
    optimum
        Metres of the hull at the bound: the least mean distance of any policy, also of random ones.
    multiplier
        Metres that a unit of cost is worth at the optimum.
    outcomes
        float64, shape ``(seeds, 2)``: expected cost and distance of each run.
    rounds
        float64, shape ``(R, 3)``: multiplier, cost and distance of all rounds of all runs;
        infinite where the goal was not reached.
    """

    results: tuple[Result, ...]
    bound: float
    optimum: float
    multiplier: float
    outcomes: NDArray[np.float64]
    rounds: NDArray[np.float64]

    @classmethod
    def of(cls, results: Sequence[Result], model: str = "best") -> "Expected":
        """What these runs do.

        Raises
        ------
        OSError
            Where a file of one cannot be read.
        ValueError
            Where one is damaged.
        """
        task: Any = results[0].run.task  # of one scene, which holds a budget
        bound: Any = task.budget
        optimum, multiplier = hull_at(task, bound)
        mixtures = [each.run.load_model(model) for each in results]
        outcomes = np.array([expectation(each, task) for each in mixtures])
        rounds = np.concatenate([each.rounds for each in mixtures])

        return cls(tuple(results), bound, optimum, multiplier, outcomes, rounds)

    @property
    def problem(self) -> Problem:
        """What they have to solve."""
        return self.results[0].problem

    def as_json(self) -> dict[str, Any]:
        """All of it for JSON."""
        record = {
            "problem": self.problem.label,
            "bound": self.bound,
            "optimum": self.optimum,
            "multiplier": self.multiplier,
            "seeds": [each.seed for each in self.results],
            "costs": [finite(each) for each in self.outcomes[:, 0].tolist()],
            "distances": [finite(each) for each in self.outcomes[:, 1].tolist()],
            "seconds": [float(each.curve.seconds[-1]) for each in self.results],
            "rounds": [[finite(number) for number in each] for each in self.rounds.tolist()],
        }
        return estimated_anew(record)


def estimated_anew(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record of `Expected.as_json` with all estimates from the outcomes that it keeps.

    ``estimates``, over seeds: expected cost and distance, the gap to the hull as a share, and the
    share of the seeds that meet the bound.
    """
    costs = _outcomes(record["costs"])
    distances = _outcomes(record["distances"])
    found = {
        "cost": estimate(costs),
        "distance": estimate(distances),
        "gap": estimate(distances / record["optimum"] - 1.0),
        "within": share(int(_meet(costs, record["bound"]).sum()), len(costs)),
    }

    return {
        **record,
        "estimates": {name: estimate_as_json(each) for name, each in found.items()},
        "penalties": _penalties(_outcomes(record["rounds"]).reshape(-1, 3), record["bound"]),
    }


def _penalties(rounds: NDArray[np.float64], bound: float) -> list[dict[str, Any]]:
    """What one policy, PPO's at a fixed price of the cost, did: the rounds ``(R, 3)``, by their
    price.
    """
    prices = np.round(rounds[:, 0], 3)
    records = []

    for price in np.unique(prices):
        trained = rounds[prices == price, 1:]
        costs, distances = trained[np.isfinite(trained).all(axis=1)].T
        records.append(
            {
                "price": float(price),
                "trainings": len(trained),
                "arrived": len(costs),
                "within": int(_meet(costs, bound).sum()),
                "cost": estimate_as_json(estimate(costs)) if len(costs) else None,
                "distance": estimate_as_json(estimate(distances)) if len(costs) else None,
            }
        )

    return records


def _outcomes(kept: Sequence[Any]) -> NDArray[np.float64]:
    """Numbers from JSON, where null stands for infinity."""
    values = np.array(kept, dtype=np.float64)
    return np.where(np.isnan(values), np.inf, values)


def _meet(costs: NDArray[np.float64], bound: float) -> NDArray[np.bool_]:
    return costs <= bound * (1.0 + _ROUNDING)


def expectation(mixture: Mixture, task: Task) -> tuple[float, float]:
    """Expected cost and distance in metres of an episode from the fixed start, exact, as all but
    the draw of a policy is certain; infinite where one of the policies does not arrive.
    """
    outcomes = np.array([play(each, task) for each in mixture.policies])  # (K, 2)
    cost, distance = mixture.shares @ outcomes

    return float(cost), float(distance)


def hull_at(task: Task, bound: float) -> tuple[float, float]:
    """The least mean distance in metres of all policies, also of random ones, whose expected cost
    is at most the bound; and by how much it falls with the bound.
    """
    world = build_world(task)
    cost = cost_map(world.radio_map, world.target_db, task.cost)
    cell_size = world.radio_map.grid.cell_size
    hull = pareto_front(cost, world.start, world.goal, cell_size).hull()
    optimum = float(hull.expected_distance(bound))

    # of the edge that leads to the bound
    right = int(np.searchsorted(hull.costs, bound))
    if not 0 < right < len(hull.costs):
        return optimum, 0.0

    run, rise = (np.diff(each[right - 1 : right + 1])[0] for each in (hull.costs, hull.distances))

    return optimum, float(-rise / run)
