"""`IrsNavCmdp`: the environments of one scene and of many as OmniSafe's `CMDP`."""

import sys
from types import ModuleType
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from gymnasium import spaces

from irs_gym.envs.cost_steps import SixTuple
from irs_gym.grid import nearest_move

# OmniSafe 0.5 imports Safety-Gymnasium, which does not load on Python 3.11 and later, and asks
# nothing of it where the environments are another's.
try:
    import safety_gymnasium as _  # noqa: F401
except (ImportError, ValueError):
    sys.modules["safety_gymnasium"] = ModuleType("safety_gymnasium")

from omnisafe.envs.core import CMDP, env_register


@env_register
class IrsNavCmdp(CMDP):  # type: ignore[misc]  # OmniSafe has no types
    """What `omnisafe.Agent(..., "IrsNavFlat-v0")` trains in, once this module is imported.

    OmniSafe's policies are Gaussian, so an action is a direction (x, y) in the plane, and the move
    the one of the eight that is nearest to it. The first step of an episode pays for the start as
    well.

    Parameters
    ----------
    env_id
        ``"IrsNavFlat-v0"`` or ``"IrsNavRandomFlat-v0"``.
    num_envs
        1: OmniSafe's ``vector_env_nums``.
    device
        Where the tensors go.
    **arguments
        Of the environment: OmniSafe's ``env_cfgs``.
    """

    _support_envs: ClassVar[list[str]] = ["IrsNavFlat-v0", "IrsNavRandomFlat-v0"]
    need_auto_reset_wrapper = True
    need_time_limit_wrapper = False

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        **arguments: Any,
    ) -> None:
        if num_envs != 1:
            raise ValueError(f"vector_env_nums={num_envs} must be 1")

        super().__init__(env_id)
        self._env = SixTuple(gymnasium.make(f"irs_gym:{env_id}", **arguments))
        self._num_envs = num_envs
        self._device = torch.device(device)
        self._observation_space = self._env.observation_space
        self._action_space = spaces.Box(-1.0, 1.0, shape=(2,), dtype=np.float32)
        self._metadata = self._env.metadata

    @property
    def max_episode_steps(self) -> int | None:
        """Steps after which an episode is truncated."""
        return self._env.spec.max_episode_steps if self._env.spec else None

    def step(self, action: torch.Tensor) -> tuple[Any, ...]:
        """Move once: observation, reward, cost, terminated, truncated, as tensors, and the info."""
        x, y = action.detach().cpu().tolist()
        *numbers, info = self._env.step(nearest_move(x, y))

        return *(self._tensor(each) for each in numbers), info

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Start an episode; returns an observation and its info."""
        observation, info = self._env.reset(seed=seed, options=options)

        return self._tensor(observation), info

    def set_seed(self, seed: int) -> None:
        """Seed what is random."""
        self.reset(seed=seed)

    def render(self) -> Any:
        """A picture, where ``render_mode`` is given among the arguments."""
        return self._env.render()

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def _tensor(self, value: Any) -> torch.Tensor:
        return torch.as_tensor(value, dtype=torch.float32, device=self._device)
