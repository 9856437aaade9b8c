"""`PolicyScore`: what a policy achieved over its episodes; `play_references`: the episodes of the
reference policies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from agents.policies.codebook_heuristics import CODEBOOK_REFERENCES
from agents.policies.continuous_heuristics import CONTINUOUS_REFERENCES
from agents.policies.heuristics import REFERENCE_POLICIES
from agents.policies.policy import Policy
from agents.rollout.episode import EpisodeResult, roll_out
from agents.single.mixture import Mixture
from irs_gym.mdp.continuous_maps import ContinuousMaps

RANDOM = (
    "masked_random",
    "random",
)  # judged by many episodes; from a fixed start the others always do the same


@dataclass(frozen=True)
class PolicyScore:
    """What a policy achieved over its episodes.

    Attributes
    ----------
    success
        Share of the episodes that reached the goal.
    distance, ratio
        Means of the metres travelled, and of these over the oracle's, in the successful episodes;
        None without any.
    spl, soft_spl
        Success weighted by path length, and the same with progress in place of success: means over
        all episodes.
    refused, steps
        Means over all episodes of the refused moves and of all moves.
    """

    policy: str
    episodes: int
    success: float
    distance: float | None
    ratio: float | None
    spl: float
    soft_spl: float
    refused: float
    steps: float


def score(policy: str, episodes: Sequence[EpisodeResult]) -> PolicyScore:
    """Score of the policy of that name from its episodes, one or more."""
    successes = [each for each in episodes if each.is_success]
    return PolicyScore(
        policy=policy,
        episodes=len(episodes),
        success=len(successes) / len(episodes),
        distance=_mean([each.distance for each in successes]),
        ratio=_mean([each.ratio for each in successes if each.ratio is not None]),
        spl=float(np.mean([each.spl for each in episodes])),
        soft_spl=float(np.mean([each.soft_spl for each in episodes])),
        refused=float(np.mean([each.refused for each in episodes])),
        steps=float(np.mean([each.steps for each in episodes])),
    )


def play_references(
    env: gymnasium.Env[Any, Any], learned: dict[str, Policy], episodes: int, seed: int
) -> dict[str, list[EpisodeResult]]:
    """Episodes of each policy by its name: the oracle's, those of the learned policies, those of
    the other references.

    ``episodes`` is how many the random policies and mixtures play; one is enough for all others.
    """
    robot: Any = env.unwrapped
    maps = getattr(robot, "maps", None)
    known: Any = REFERENCE_POLICIES if maps is None else CODEBOOK_REFERENCES
    known = CONTINUOUS_REFERENCES if isinstance(maps, ContinuousMaps) else known
    references = {name: make(env, seed) for name, make in known.items()}
    policies = {"oracle": references.pop("oracle"), **learned, **references}
    return {
        name: [
            roll_out(policy, env)
            for _ in range(episodes if name in RANDOM or isinstance(policy, Mixture) else 1)
        ]
        for name, policy in policies.items()
    }


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
