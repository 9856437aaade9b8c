"""`SixTuple` and `VectorReward`: steps that return the cost beside the reward, as libraries for
constrained and for multi-objective problems read it.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray


class SixTuple(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The steps of Safety-Gymnasium: ``obs, reward, cost, terminated, truncated, info``.

    The first step of an episode pays for the start as well, so that costs add up to the total of
    the path, as `irs_gym.Front` counts it. ``info["cost"]`` stays what it is.

    Parameters
    ----------
    env
        An environment that tells ``"cost"`` in its infos, such as those of this package.

    Examples
    --------
    >>> env = SixTuple(gymnasium.make("irs_gym:IrsNav-v0", constraint="allow", target_db=-60.0))
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, cost, terminated, truncated, info = env.step(0)
    >>> cost
    0.0
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self._paid_at_start = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode; returns an observation and its info."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._paid_at_start = _cost(info)

        return observation, info

    def step(  # type: ignore[override]  # one more than Gymnasium's
        self, action: Any
    ) -> tuple[Any, float, float, bool, bool, dict[str, Any]]:
        """Move once; the cost stands behind the reward."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        cost = _cost(info) + self._paid_at_start
        self._paid_at_start = 0.0

        return observation, float(reward), cost, terminated, truncated, info


class VectorReward(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The rewards of MO-Gymnasium: float32, ``(reward, -cost)``, both the larger the better.

    Costs are those of `SixTuple`. ``reward_space`` is set on the environment itself as well, since
    it is looked for in ``env.unwrapped``.

    Parameters
    ----------
    env
        An environment that tells ``"cost"`` in its infos, such as those of this package.

    Examples
    --------
    >>> settings = {"constraint": "budget", "budget": 40.0, "target_db": -55.0}
    >>> env = VectorReward(gymnasium.make("irs_gym:IrsNav-v0", **settings))
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(0)  # the start is paid as well
    >>> reward.tolist()
    [0.0, -2.0]
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self._steps = SixTuple(env)
        super().__init__(self._steps)
        self.reward_space = spaces.Box(-np.inf, np.inf, shape=(2,), dtype=np.float32)
        self.unwrapped.reward_space = self.reward_space  # type: ignore[attr-defined]

    def step(self, action: Any) -> tuple[Any, NDArray[np.float32], bool, bool, dict[str, Any]]:
        """Move once; the reward is ``(reward, -cost)``."""
        observation, reward, cost, terminated, truncated, info = self._steps.step(action)

        return observation, np.array([reward, -cost], np.float32), terminated, truncated, info


def _cost(info: dict[str, Any]) -> float:
    """The cost that an info tells; a ``ValueError`` where it tells none."""
    if "cost" not in info:
        raise ValueError("the infos of the environment hold no cost: infos= must name 'cost'")

    return float(info["cost"])
