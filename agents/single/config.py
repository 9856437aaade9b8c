"""`AgentConfig` and `NetworkConfig`: the settings that algorithms have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gymnasium import spaces

from agents.registry import Algorithm, Generalist, model_class

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

Kind = Literal["whole", "positive", "share"]
_KINDS: dict[Kind, tuple[Callable[[Any], bool], str]] = {
    "whole": (lambda value: value >= 1, "a positive integer"),
    "positive": (lambda value: 0 < value < float("inf"), "a positive number"),
    "share": (lambda value: 0 <= value <= 1, "a number from 0 to 1"),
}


def check_settings(settings: Any, kind: Kind, *names: str) -> None:
    """Raise a ``ValueError`` that names the first of these fields whose value is not of the kind."""
    is_right, wanted = _KINDS[kind]

    for name in names:
        if not is_right(getattr(settings, name)):
            raise ValueError(f"{name}={getattr(settings, name)} must be {wanted}")


@dataclass(frozen=True, kw_only=True)
class AgentConfig:
    """Settings of every algorithm; the defaults of each are the tuned ones.

    Raises ``ValueError`` where a value is out of its range; the message names the field.
    """

    algorithm: ClassVar[Algorithm | Generalist]

    total_timesteps: int
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    learning_rate: float
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float
    """Learning rate at the end of the schedule."""
    gamma: float
    """Discount factor."""

    def __post_init__(self) -> None:
        self._check_whole("total_timesteps", "n_envs")
        self._check_positive("learning_rate", "final_learning_rate")
        self._check_share("gamma")

    def build(self, env: VecEnv, seed: int) -> Any:
        """The model, untrained. ``env`` should hold `n_envs` environments."""
        raise NotImplementedError

    def _check_whole(self, *names: str) -> None:
        check_settings(self, "whole", *names)

    def _check_positive(self, *names: str) -> None:
        check_settings(self, "positive", *names)

    def _check_share(self, *names: str) -> None:
        check_settings(self, "share", *names)


@dataclass(frozen=True, kw_only=True)
class NetworkConfig(AgentConfig):
    """Settings of the algorithms of Stable-Baselines3 under its own names, so that each is handed
    on as it is.
    """

    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch",)  # handed on to the networks
    env_settings: ClassVar[tuple[str, ...]] = ()  # handed on to the environment

    net_arch: tuple[int, ...]
    """Widths of the hidden layers of each network."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(width < 1 for width in self.net_arch):
            raise ValueError(f"net_arch={self.net_arch} must hold positive widths")

    def build(self, env: VecEnv, seed: int) -> Any:
        """The model, untrained. ``env`` should hold `n_envs` environments."""
        from stable_baselines3.common.utils import LinearSchedule

        elsewhere = ("total_timesteps", "n_envs", *self.policy_settings, *self.env_settings)
        own = {name: value for name, value in asdict(self).items() if name not in elsewhere}
        rates = own.pop("learning_rate"), own.pop("final_learning_rate")

        return model_class(self.algorithm)(
            self.policy_name(env.observation_space),
            env,
            learning_rate=LinearSchedule(*rates, 1.0),
            policy_kwargs=self.policy_kwargs(),
            seed=seed,
            device="cpu",  # faster than a GPU for networks this small
            **own,
        )

    def policy_name(self, space: spaces.Space[Any]) -> str:
        """SB3's name of the policy for these observations."""
        return "MultiInputPolicy" if isinstance(space, spaces.Dict) else "MlpPolicy"

    def features(self, width: int) -> int:
        """Numbers, at the least, that the first layer reads of an observation of that many."""
        return width

    def policy_kwargs(self) -> dict[str, Any]:
        """What is handed on to the networks."""
        return {
            **{name: getattr(self, name) for name in self.policy_settings},
            "net_arch": list(self.net_arch),
        }
