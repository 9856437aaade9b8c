"""Contenders of `python -m eval speed`: environments of this package and of others, stepped by
random actions.
"""

import warnings
from collections.abc import Callable
from importlib import import_module
from itertools import cycle, islice
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from eval.benchmark.timing import Steps
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.packing import Packing

ID = "irs_gym:IrsNav-v0"
CODEBOOK_ID = "irs_gym:IrsNavCodebook-v0"
CODEBOOK = "IrsNavCodebook-v0, K = 16"
CONTINUOUS = "IrsNavContinuous-v0"
CONTINUOUS_ID = f"irs_gym:{CONTINUOUS}"
PENDULUM = "Pendulum-v1"
SYNC_PENDULUM = "Pendulum-v1 in SyncVectorEnv"
CYCLE = 401  # steps of a whole episode of IrsNav-v0 under random actions, the reset included
BenchmarkEnvs = dict[str, tuple[str, Callable[[], Steps]]]
"""By name: the package that it needs, and how to prepare it."""

SINGLE: BenchmarkEnvs = {
    "IrsNav-v0": ("irs_gym", lambda: single(ID)),
    "IrsNav-v0, flat": ("irs_gym", lambda: single(ID, observation="flat")),
    CODEBOOK: ("irs_gym", lambda: single(CODEBOOK_ID, codebook=("cover", 16))),
    CONTINUOUS: ("irs_gym", lambda: single(CONTINUOUS_ID)),
    "CartPole-v1": ("gymnasium", lambda: single("CartPole-v1")),
    PENDULUM: ("gymnasium", lambda: single(PENDULUM)),
    "FrozenLake-v1": ("gymnasium", lambda: single("FrozenLake-v1")),
    "Minigrid Empty-16x16": ("minigrid", lambda: single("MiniGrid-Empty-16x16-v0")),
    "mobile-env small": ("mobile_env", lambda: single("mobile-small-central-v0")),
}


def vector(num_envs: int) -> BenchmarkEnvs:
    """Contenders that step ``num_envs`` environments at once."""
    same_step = {"autoreset_mode": "SameStep"}
    counted: dict[str, Any] = {
        "constraint": "budget",
        "budget": 26.0,
        "on_exhausted": "continue",
    }
    return {
        "IrsNav-v0": ("irs_gym", lambda: batch(ID, num_envs)),
        "IrsNav-v0, SAME_STEP": ("irs_gym", lambda: batch(ID, num_envs, **same_step)),
        "IrsNav-v0, copy=False": ("irs_gym", lambda: batch(ID, num_envs, copy=False)),
        "IrsNav-v0, infos='all'": ("irs_gym", lambda: batch(ID, num_envs, infos="all")),
        "IrsNav-v0, a budget, counted": ("irs_gym", lambda: batch(ID, num_envs, **counted)),
        "IrsNav-v0, a budget that ends episodes": (
            "irs_gym",
            lambda: batch(ID, num_envs, constraint="budget", budget=26.0),
        ),
        "IrsNav-v0, infos=[]": ("irs_gym", lambda: batch(ID, num_envs, infos=[])),
        CODEBOOK: ("irs_gym", lambda: batch(CODEBOOK_ID, num_envs, codebook=("cover", 16))),
        CONTINUOUS: ("irs_gym", lambda: batch(CONTINUOUS_ID, num_envs)),
        f"{CONTINUOUS}, flat": (
            "irs_gym",
            lambda: batch(CONTINUOUS_ID, num_envs, observation="flat"),
        ),
        f"{CONTINUOUS}, infos='all'": (
            "irs_gym",
            lambda: batch(CONTINUOUS_ID, num_envs, infos="all"),
        ),
        SYNC_PENDULUM: (
            "gymnasium",
            lambda: batch(PENDULUM, num_envs, vectorization_mode="sync"),
        ),
        "bare np.take": ("irs_gym", lambda: bare_take(num_envs)),
        "CartPole-v1": (
            "gymnasium",
            lambda: batch("CartPole-v1", num_envs, vectorization_mode="vector_entry_point"),
        ),
        "EnvPool FrozenLake-v1": ("envpool", lambda: envpool_batch("FrozenLake-v1", num_envs)),
        "Navix Empty-16x16": (
            "navix",
            lambda: import_module("eval.benchmark.jax_envs").navix_batch(num_envs),
        ),
        "Jumanji Maze": (
            "jumanji",
            lambda: import_module("eval.benchmark.jax_envs").jumanji_batch(num_envs),
        ),
    }


def prepare(contenders: BenchmarkEnvs) -> tuple[dict[str, Steps], dict[str, str]]:
    """The contenders whose package is installed, ready to run; and the packages of those left out,
    by name.
    """
    ready = {}
    left_out = {}

    for name, (package, make) in contenders.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # those of the peers are theirs
                import_module(package)
                ready[name] = make()
        except ModuleNotFoundError as error:
            left_out[name] = error.name or package

    return ready, left_out


def single(env_id: str, **arguments: Any) -> Steps:
    """One environment as `gymnasium.make` gives it, reset whenever an episode ends."""
    env = gymnasium.make(env_id, **arguments)
    env.reset(seed=0)
    env.action_space.seed(0)
    samples = [env.action_space.sample() for _ in range(1024)]

    # plain integers, as a loop of one's own would pass them
    is_discrete = isinstance(env.action_space, spaces.Discrete)
    actions = cycle([int(each) for each in samples] if is_discrete else samples)

    def steps(calls: int) -> int:
        for action in islice(actions, calls):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

        return calls

    return steps


def batch(env_id: str, num_envs: int, **arguments: Any) -> Steps:
    """A vector environment as `gymnasium.make_vec` gives it, with what it does at the end of
    episodes.
    """
    env: Any = gymnasium.make_vec(env_id, num_envs=num_envs, **arguments)
    env.reset(seed=0)
    actions = cycle(_sampled(env.single_action_space, num_envs))

    def steps(calls: int) -> int:
        for action in islice(actions, calls):
            env.step(action)

        return calls * num_envs

    return steps


def bare_take(num_envs: int) -> Steps:
    """The gather of the rows of observations that `batch` returns, into one buffer, and nothing
    else.

    No environment that keeps its observations in a table can be faster.
    """
    env: Any = gymnasium.make_vec(ID, num_envs=num_envs)
    env.reset(seed=0)
    table = build_observer(env.world, env.world.goal).table
    if table is None:
        raise ValueError(f"{ID} keeps no table of observations to gather from")

    states = cycle([_cells(env.step(action)[0], env.world) for action in _actions(8, num_envs)])
    buffer = np.empty((num_envs, table.shape[1]), dtype=table.dtype)

    def steps(calls: int) -> int:
        for state in islice(states, calls):
            np.take(table, state, axis=0, out=buffer, mode="clip")

        return calls * num_envs

    return steps


def _cells(observation: Any, world: Any) -> Any:
    """Flat cells that robots are in, from their own position in the observation."""
    return Packing.of(observation, world.feasible.shape).own_cells(observation)


def envpool_batch(env_id: str, num_envs: int) -> Steps:
    """An environment of EnvPool, on as many threads as it likes."""
    env = import_module("envpool").make(env_id, env_type="gymnasium", num_envs=num_envs)
    env.reset()
    actions = cycle([each.astype(np.int32) for each in _actions(env.action_space.n, num_envs)])

    def steps(calls: int) -> int:
        for action in islice(actions, calls):
            env.step(action)

        return calls * num_envs

    return steps


def _sampled(space: Any, num_envs: int) -> Any:
    """Actions of a space, all equally likely."""
    if isinstance(space, spaces.Discrete):
        return _actions(int(space.n), num_envs)

    rng = np.random.default_rng(0)
    actions = rng.uniform(space.low, space.high, (CYCLE, num_envs, *space.shape))

    return actions.astype(space.dtype)


def _actions(count: int, num_envs: int) -> Any:
    return np.random.default_rng(0).integers(count, size=(CYCLE, num_envs))
