"""`collect`: labelled episodes of a policy between the oracle and chance, as plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.splits import split_of
from irs_gym.mdp.task import Observation
from train.datasets.labels import labels_of

PolicyName = Literal["oracle", "mixed", "random"]
EnvName = Literal["IrsNav-v0", "IrsNavRandom-v0"]
MOST_EPISODES = 1_000_000
STEPS = 400  # of an episode, at the most
LABELS = {
    "optimal_actions": "whether each of the eight actions begins a shortest way to the goal",
    "distance_to_go": "metres of the shortest way to the goal",
    "regret": "metres that the step before lost against the best action; 0 at the reset",
}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where episodes come from: equal ones give equal episodes.

    Raises ``ValueError`` where a value is out of its range; the message names the field.
    """

    policy: PolicyName = "oracle"
    """The "oracle", drawn among all its best actions; at "random", any of the eight; "mixed", the
    one or the other at each step, with a probability that is drawn for each episode."""
    env: EnvName = "IrsNav-v0"
    """One scene, or one after the other of a split."""
    episodes: int = 1000
    """How many."""
    seed: int = 0
    """Of all that is drawn."""
    observation: Observation = "flat"
    """What is observed; see the environments."""
    random_start: float = 0.5
    """Probability of a start drawn among the cells from which the goal can be reached."""
    target_db: float | None = None
    """Target of the one scene in dB; as the scene says by default."""
    scene: str = "paper"
    """The one scene: of the package, or the path of a scene file."""
    split: str = "train"
    """Which generated scenes."""
    num_scenes: int = 1000
    """How many of them, from the first on."""

    def __post_init__(self) -> None:
        for name, most in (("episodes", MOST_EPISODES), ("num_scenes", split_of(self.split).size)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= most:
                raise ValueError(f"{name}={value!r} must be a number from 1 to {most:,}")

        if not isinstance(self.seed, int) or not 0 <= self.seed < 2**32:
            raise ValueError(f"seed={self.seed!r} must be an integer from 0 to 2**32 - 1")
        if self.policy not in ("oracle", "mixed", "random"):
            raise ValueError(f"policy={self.policy!r} must be one of oracle, mixed, random")

        own = ("split", "num_scenes") if self.env == "IrsNav-v0" else ("scene", "target_db")
        given = [name for name in own if getattr(self, name) != getattr(Source, name)]
        if given:
            raise ValueError(f"{', '.join(given)} cannot be given along with env={self.env!r}")

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of `gymnasium.make`."""
        both = {"observation": self.observation, "random_start": self.random_start}
        if self.env == "IrsNav-v0":
            return {**both, "scene": self.scene, "target_db": self.target_db}
        return {**both, "split": self.split, "num_scenes": self.num_scenes}

    def make_env(self, **others: Any) -> gymnasium.Env[Any, Any]:
        """The environment, with other arguments in place of these."""
        return gymnasium.make(f"irs_gym:{self.env}", **{**self.arguments, **others})

    def epsilon(self, rng: np.random.Generator) -> float:
        """How often an episode leaves the oracle."""
        return {"oracle": 0.0, "random": 1.0}.get(self.policy, float(rng.random()))


@dataclass
class LabelledEpisode:
    """One episode of T steps; of infos there are T + 1, the first that of the reset.

    ``observations`` are arrays by the keys of a Dict, else of one key, ``""``. The labels are among
    the infos: row t tells ``optimal_actions`` and ``distance_to_go`` where action t is chosen, row
    t + 1 the ``regret`` of action t.
    """

    epsilon: float
    scene: str
    observations: dict[str, list[Any]] = field(default_factory=dict)
    actions: list[int] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    terminations: list[bool] = field(default_factory=list)
    truncations: list[bool] = field(default_factory=list)
    infos: dict[str, list[Any]] = field(default_factory=dict)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it as arrays, named ``observations/KEY``, ``infos/KEY``, ``actions`` and so on."""
        found = {f"observations/{key}": np.stack(each) for key, each in self.observations.items()}
        found |= {f"infos/{key}": np.stack(each) for key, each in self.infos.items()}
        found["actions"] = np.array(self.actions, dtype=np.int64)
        found["rewards"] = np.array(self.rewards, dtype=np.float64)
        found["terminations"] = np.array(self.terminations)
        found["truncations"] = np.array(self.truncations)

        return found


def collect(source: Source, env: gymnasium.Env[Any, Any], number: int) -> LabelledEpisode:
    """The episode of that number, whatever else was collected before it."""
    rng = np.random.default_rng((source.seed, number))
    robot: Any = env.unwrapped
    is_one = source.env == "IrsNav-v0"
    options = None if is_one else {"scene_id": number % len(robot.worlds)}
    observation, info = env.reset(seed=int(rng.integers(2**31)), options=options)
    labels = labels_of(robot.world, robot.world.goal)
    cells = robot.radio_map.grid.flat
    here = cells(robot.path[-1])

    scene = robot.world.scene.name
    episode = LabelledEpisode(source.epsilon(rng), scene)
    _keep(episode, observation, info, labels.is_optimal[here], 0.0)
    is_over = False

    while not is_over:
        is_random = rng.random() < episode.epsilon
        action = int(
            rng.integers(8) if is_random else rng.choice(np.flatnonzero(labels.is_optimal[here]))
        )
        observation, reward, is_terminated, is_truncated, info = env.step(action)
        is_over = is_terminated or is_truncated

        regret = float(labels.regret[here, action])
        here = cells(robot.path[-1])
        _keep(episode, observation, info, labels.is_optimal[here], regret)
        episode.actions.append(action)
        episode.rewards.append(float(reward))
        episode.terminations.append(is_terminated)
        episode.truncations.append(is_truncated)

    return episode


def _keep(
    episode: LabelledEpisode,
    observation: Any,
    info: Mapping[str, Any],
    is_optimal: NDArray[np.bool_],
    regret: float,
) -> None:
    """Add what is observed and told, with the labels."""
    seen = observation if isinstance(observation, dict) else {"": observation}
    for key, value in seen.items():
        episode.observations.setdefault(key, []).append(value)

    told = {key: value for key, value in info.items() if not isinstance(value, str)}
    for key, value in {**told, "optimal_actions": is_optimal, "regret": regret}.items():
        episode.infos.setdefault(key, []).append(value)
