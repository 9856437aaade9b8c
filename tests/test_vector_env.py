"""Facts about the vector environment, most of them against Gymnasium's own over single environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

ID = "irs_gym:IrsNav-v0"
# close ends and a short limit: many episodes of every kind in few steps
OFTEN = {"target_db": -62.2, "patch_radius": 2, "start": (30, 22), "goal": (33, 20), "max_episode_steps": 30}


def both(n: int, mode: AutoresetMode, **kwargs) -> tuple[gymnasium.vector.VectorEnv, SyncVectorEnv]:
    ours = gymnasium.make_vec(ID, num_envs=n, autoreset_mode=mode, **kwargs)
    single = SyncVectorEnv([lambda: gymnasium.make(ID, **kwargs)] * n, autoreset_mode=mode)
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
    """Level the one difference: the path at the step limit, which a single env under TimeLimit cannot put in its info."""
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


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize("observation", ["dict", "flat", "map"])
def test_vector_env_equals_n_single_envs(constraint, observation, mode):
    ours, single = both(
        5, mode, constraint=constraint, observation=observation, random_start=0.5, goal_bonus=30.0, **OFTEN
    )
    rng = np.random.default_rng(1)
    assert_same(ours.reset(seed=7), single.reset(seed=7))
    ends = 0
    for step in range(10_000 // 5):
        if step % 500 == 499:
            assert_same(ours.reset(seed=step), single.reset(seed=step))
        actions = rng.integers(0, 8, 5)
        mine, other = ours.step(actions), single.step(actions)
        level_paths(mine, other, single)
        assert_same(mine, other, f"step {step}: ")
        ends += int((mine[2] | mine[3]).sum())
    assert ends > 300
