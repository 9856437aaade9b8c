"""How vector environments are held against Gymnasium's own over single environments: step by step, to the last bit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

if TYPE_CHECKING:  # older versions of Gymnasium have none, and single environments alone are tested there
    from gymnasium.vector import AutoresetMode


def both(env_id: str, n: int, mode: AutoresetMode, **kwargs) -> tuple[gymnasium.vector.VectorEnv, SyncVectorEnv]:
    """Our vector environment, and Gymnasium's."""
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


def level_paths(ours, theirs, single: SyncVectorEnv) -> None:
    """Level the one difference: the path at the step limit, which a single env cannot put in its info."""
    _, _, terminated, truncated, infos = ours
    if "final_info" in infos:  # the single envs have moved on: only paths of terminated ones can be compared
        final = infos["final_info"]
        final["path"][~terminated] = None
        final["_path"] = terminated.copy()
        if not terminated.any():
            del final["path"], final["_path"]
    elif (terminated | truncated).any():
        paths = theirs[4].setdefault("path", np.full(single.num_envs, None, dtype=object))
        theirs[4]["_path"] = terminated | truncated
        for i in np.flatnonzero(terminated | truncated):
            paths[i] = single.envs[i].unwrapped.path


def assert_equal_for(steps: int, ours: gymnasium.vector.VectorEnv, single: SyncVectorEnv) -> int:
    """Step both by random actions, with a reset at times; returns the number of episodes that ended."""
    rng = np.random.default_rng(1)
    assert_same(ours.reset(seed=7), single.reset(seed=7))
    ends = 0
    for step in range(steps):
        if step % 500 == 499:
            assert_same(ours.reset(seed=step), single.reset(seed=step))
        actions = rng.integers(0, 8, single.num_envs)
        mine, other = ours.step(actions), single.step(actions)
        level_paths(mine, other, single)
        assert_same(mine, other, f"step {step}: ")
        ends += int((mine[2] | mine[3]).sum())
    return ends
