"""`IrsNavVecEnv`: a vector environment as Stable-Baselines3's own `VecEnv`, much faster than
`DummyVecEnv`.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from irs_gym.envs.codebook_vector_nav import IrsNavCodebookVectorEnv
from irs_gym.envs.continuous_vector_nav import IrsNavContinuousVectorEnv
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from irs_gym.envs.vector_nav import IrsNavVectorEnv


class IrsNavVecEnv(VecEnv):
    """Training with it equals training with a `DummyVecEnv` of single environments, action for
    action.

    Infos are those of the single environment, with ``TimeLimit.truncated`` at each step, and at an
    end also with ``terminal_observation`` and ``episode``, as Stable-Baselines3's `Monitor` gives
    it.

    Parameters
    ----------
    num_envs
        Number of environments n.
    max_episode_steps
        Steps after which an episode is truncated.
    render_mode
        ``"rgb_array"`` or ``"ansi"``.
    vector_env
        What is made: `IrsNavVectorEnv`, `IrsNavRandomVectorEnv` for many scenes,
        `IrsNavCodebookVectorEnv` where the robot switches the panel, or `IrsNavContinuousVectorEnv`
        where it goes anywhere on the floor.
    **env_kwargs
        Its arguments: the fields of `irs_gym.mdp.task.Task`, of
        `irs_gym.datasets.random_task.RandomTask`, of `irs_gym.datasets.codebook_task.CodebookTask`
        or of `irs_gym.datasets.continuous_task.ContinuousTask`.
    """

    def __init__(
        self,
        num_envs: int,
        max_episode_steps: int = 400,
        render_mode: str | None = None,
        *,
        vector_env: type[
            IrsNavVectorEnv
            | IrsNavRandomVectorEnv
            | IrsNavCodebookVectorEnv
            | IrsNavContinuousVectorEnv
        ] = IrsNavVectorEnv,
        **env_kwargs: Any,
    ) -> None:
        env_kwargs.setdefault("infos", "all")
        self.envs = vector_env(
            num_envs,
            max_episode_steps,
            AutoresetMode.SAME_STEP,
            render_mode=render_mode,
            **env_kwargs,
        )
        self.render_mode = render_mode
        self._actions: NDArray[Any] = np.zeros(num_envs, dtype=np.int64)
        self._return = np.zeros(num_envs)
        self._length = np.zeros(num_envs, dtype=np.int64)
        self._began = time.time()
        self.envs.spec = self.spec = _spec(vector_env, max_episode_steps, env_kwargs)
        super().__init__(
            num_envs, self.envs.single_observation_space, self.envs.single_action_space
        )

    def reset(self) -> Any:
        """Start an episode everywhere, with the seeds and options that were set before; returns
        observations.
        """
        seeds = list(self._seeds) if any(seed is not None for seed in self._seeds) else None
        options = self._options[0] if self._options else None
        if any(each != options for each in self._options):
            raise ValueError("options must be the same for all environments")

        observation, infos = self.envs.reset(seed=seeds, options=options)
        self._return[:] = 0.0
        self._length[:] = 0
        self.reset_infos = _one_by_one(infos)
        self._reset_seeds()
        self._reset_options()

        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Move every robot once; an environment that ends begins anew in the same step."""
        observation, reward, terminated, truncated, infos = self.envs.step(self._actions)
        self._return += reward
        self._length += 1

        each_info = _one_by_one(infos)
        done = terminated | truncated

        for info in each_info:
            info["TimeLimit.truncated"] = False

        if done.any():
            final_infos = _one_by_one(infos["final_info"])
            for i in np.flatnonzero(done).tolist():
                self.reset_infos[i] = {key: each_info[i][key] for key in final_infos[i]}
                each_info[i] = {
                    **final_infos[i],
                    "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                    "terminal_observation": infos["final_obs"][i],
                    "episode": self._episode(i),
                }

        self._return[done] = 0.0
        self._length[done] = 0

        return observation, reward.astype(np.float32), done, each_info

    def _episode(self, i: int) -> dict[str, Any]:
        """Return, length and seconds of an episode that ends, as SB3's `Monitor` gives them."""
        return {
            "r": round(float(self._return[i]), 6),
            "l": int(self._length[i]),
            "t": round(time.time() - self._began, 6),
        }

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of each single environment, such as ``oracle`` or ``action_space``."""
        values = self.envs.get_attr(attr_name)
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(
        self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
    ) -> None:
        """Set an attribute of your own in environments; those that they have are shared, and
        refused.
        """
        chosen = [*self._get_indices(indices)]
        if len(chosen) < self.num_envs:
            values = [*self.get_attr(attr_name)]
            for i in chosen:
                values[i] = value
        else:
            values = [value] * self.num_envs

        self.envs.set_attr(attr_name, values)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """What a method of each single environment returns; moving one alone is refused."""
        if method_name == "action_masks":  # asked for at every step, and known for all at once
            values: Any = self.envs.action_masks()  # type: ignore[union-attr]  # of those that have
        else:
            values = self.envs.call(method_name, *method_args, **method_kwargs)

        return [values[i] for i in self._get_indices(indices)]

    def has_attr(self, attr_name: str) -> bool:
        """Whether there is such an attribute or method."""
        try:
            self.envs.get_attr(attr_name)
        except AttributeError:
            return False

        return True

    def env_is_wrapped(
        self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """True for `Monitor`, whose ``episode`` is in the infos; False for every other wrapper."""
        return [issubclass(Monitor, wrapper_class) for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of each environment; needs ``render_mode="rgb_array"``."""
        return list(self.envs.render() or [None] * self.num_envs)


def _spec(vector_env: type[Any], max_episode_steps: int, env_kwargs: dict[str, Any]) -> EnvSpec:
    """How `gymnasium.make` would make one of the environments."""
    env_id = _IDS[vector_env]
    return replace(gymnasium.spec(env_id), max_episode_steps=max_episode_steps, kwargs=env_kwargs)


_IDS: dict[type[Any], str] = {
    IrsNavVectorEnv: "IrsNav-v0",
    IrsNavRandomVectorEnv: "IrsNavRandom-v0",
    IrsNavCodebookVectorEnv: "IrsNavCodebook-v0",
    IrsNavContinuousVectorEnv: "IrsNavContinuous-v0",
}


def _one_by_one(infos: dict[str, Any]) -> list[dict[str, Any]]:
    """The infos of each environment, as Python's own types; arrays stay arrays."""
    keys = [key for key in infos if not key.startswith(("_", "final_"))]
    columns = [infos[key].tolist() if infos[key].ndim == 1 else [*infos[key]] for key in keys]
    return [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
