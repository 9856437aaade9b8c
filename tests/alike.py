"""How vector environments are held against Gymnasium's own over single environments: step by step,
to the last bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

if (
    TYPE_CHECKING
):  # older versions of Gymnasium have none, and single environments alone are tested there
    from gymnasium.vector import AutoresetMode


def both(
    env_id: str, n: int, mode: AutoresetMode, **kwargs
) -> tuple[gymnasium.vector.VectorEnv, SyncVectorEnv]:
    """Our vector environment, and Gymnasium's."""
    kwargs.setdefault("infos", "all")
    ours = gymnasium.make_vec(env_id, num_envs=n, autoreset_mode=mode, **kwargs)
    single = SyncVectorEnv([lambda: gymnasium.make(env_id, **kwargs)] * n, autoreset_mode=mode)
    return ours, single


def assert_same(ours, theirs, where="") -> None:
    """Equal values, types and structure, however deep."""
    if isinstance(ours, dict):
        assert set(ours) == set(theirs), where
        for key in ours:
            assert_same(ours[key], theirs[key], f"{where}[{key}]")
    elif isinstance(ours, tuple) or (isinstance(ours, np.ndarray) and ours.dtype == object):
        assert type(ours) is type(theirs), where
        for n, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(mine, other, f"{where}[{n}]")
    elif isinstance(ours, np.ndarray):
        assert ours.dtype == theirs.dtype, (where, ours.dtype, theirs.dtype)
        np.testing.assert_array_equal(ours, theirs, err_msg=where)
    else:
        assert ours == theirs, where


def assert_equal_for(steps: int, ours: gymnasium.vector.VectorEnv, single: SyncVectorEnv) -> int:
    """Step both by random actions, with a reset at times; returns the number of episodes that
    ended.
    """
    rng = np.random.default_rng(1)
    assert_same(ours.reset(seed=7), single.reset(seed=7))
    ends = 0
    for step in range(steps):
        if step % 500 == 499:
            assert_same(ours.reset(seed=step), single.reset(seed=step))
        actions = some_actions(rng, ours.single_action_space, single.num_envs)
        mine, other = ours.step(actions), single.step(actions)
        assert_same(mine, other, f"step {step}: ")
        if step % 10 == 0:
            assert_same(ours.unwrapped.get_attr("path"), single.get_attr("path"))
        ends += int((mine[2] | mine[3]).sum())
    return ends


def some_actions(rng: np.random.Generator, space: gymnasium.Space, n: int) -> np.ndarray:
    """Random actions of n robots; of headings, some beyond the unit disc, along an axis, or none."""
    if isinstance(space, gymnasium.spaces.Discrete):
        return rng.integers(0, space.n, n)

    actions = rng.uniform(-1.3, 1.3, (n, *space.shape))
    actions[rng.random(actions.shape) < 0.1] = 0.0

    return actions
