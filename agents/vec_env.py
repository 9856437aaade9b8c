"""`IrsNavVecEnv`: a vector environment as Stable-Baselines3's own `VecEnv`, much faster than `DummyVecEnv`."""

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from irs_gym.random_vector_env import IrsNavRandomVectorEnv
from irs_gym.vector_env import IrsNavVectorEnv


class IrsNavVecEnv(VecEnv):
    """Training with it equals training with a `DummyVecEnv` of single environments, action for action.

    Infos are those of the single environment, with ``TimeLimit.truncated`` at each step, and at an end also with
    ``terminal_observation`` and ``episode``, as Stable-Baselines3's `Monitor` gives it.

    Parameters
    ----------
    num_envs
        Number of environments n.
    max_episode_steps
        Steps after which an episode is truncated.
    render_mode
        ``"rgb_array"`` or ``"ansi"``.
    vector_env
        What is made: `IrsNavVectorEnv`, or `IrsNavRandomVectorEnv` for many scenes.
    **env_kwargs
        Its arguments: the fields of `irs_gym.task.Task`, or of `irs_gym.random_task.RandomTask`.
    """

    def __init__(
        self,
        num_envs: int,
        max_episode_steps: int = 400,
        render_mode: str | None = None,
        *,
        vector_env: type[IrsNavVectorEnv | IrsNavRandomVectorEnv] = IrsNavVectorEnv,
        **env_kwargs: Any,
    ) -> None:
        self.envs = vector_env(
            num_envs, max_episode_steps, AutoresetMode.SAME_STEP, render_mode=render_mode, **env_kwargs
        )
        self.render_mode = render_mode
        self._actions = np.zeros(num_envs, dtype=np.int64)
        self._return, self._length = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64)
        self._began = time.time()
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """Start an episode everywhere, with the seeds and options that were set before; returns observations."""
        seeds = list(self._seeds) if any(seed is not None for seed in self._seeds) else None
        options = self._options[0] if self._options else None
        if any(each != options for each in self._options):
            raise ValueError("options must be the same for all environments")
        observation, infos = self.envs.reset(seed=seeds, options=options)
        self._return[:], self._length[:] = 0.0, 0
        self.reset_infos = [_scalars(_OPENING_KEYS, infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: NDArray[np.integer[Any]]) -> None:
        """Take the actions of the next step."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Move every robot once; an environment that ends begins anew in the same step."""
        observation, reward, terminated, truncated, infos = self.envs.step(self._actions)
        self._return += reward
        self._length += 1
        done = terminated | truncated
        each_info: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done).tolist():
            each_info[i] = self._final_info(i, infos, bool(truncated[i] and not terminated[i]))
            self.reset_infos[i] = _scalars(_OPENING_KEYS, infos, i)
        self._return[done], self._length[done] = 0.0, 0
        return observation, reward.astype(np.float32), done, each_info

    def _final_info(self, i: int, infos: dict[str, Any], is_truncated: bool) -> dict[str, Any]:
        final = infos["final_info"]
        episode = {
            "r": round(float(self._return[i]), 6),
            "l": int(self._length[i]),
            "t": round(time.time() - self._began, 6),
        }
        return {
            **_scalars(_FINAL_KEYS, final, i),
            "path": final["path"][i],
            "TimeLimit.truncated": is_truncated,
            "terminal_observation": infos["final_obs"][i],
            "episode": episode,
        }

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of the vector environment, or of what all its environments share, once for each."""
        if not hasattr(self.envs, attr_name):
            raise AttributeError(f"IrsNavVecEnv has no attribute {attr_name!r}")
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Refused: the environments share all their attributes, and those never change."""
        raise AttributeError(f"{attr_name!r} cannot be set: make a new IrsNavVecEnv with other arguments")

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """``action_masks`` of each environment, bool ``(8,)``; no other method is known."""
        if method_name != "action_masks":
            raise AttributeError(f"IrsNavVecEnv has no method {method_name!r} for single environments")
        masks = self.envs.action_masks()
        return [masks[i] for i in self._get_indices(indices)]

    def has_attr(self, attr_name: str) -> bool:
        """Whether there is such an attribute or method."""
        return attr_name == "action_masks" or hasattr(self.envs, attr_name)

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
        """True for `Monitor`, whose ``episode`` is in the infos; False for every other wrapper."""
        return [issubclass(Monitor, wrapper_class) for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of each environment; needs ``render_mode="rgb_array"``."""
        return list(self.envs.render() or [None] * self.num_envs)


def _scalars(keys: Sequence[str], infos: dict[str, Any], i: int) -> dict[str, Any]:
    """What the infos say of environment i, as Python's own types; keys that they lack are left out."""
    return {key: infos[key][i : i + 1].tolist()[0] for key in keys if key in infos}
