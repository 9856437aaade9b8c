"""Contenders that need JAX: compiled loops over environments that live in it, on all cores."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from eval.benchmark.timing import Steps

STRIDE = 16  # steps in a compiled loop, so that calling it costs next to nothing


def navix_batch(num_envs: int) -> Steps:
    """Navix's copy of Minigrid's empty room."""
    import navix

    env = navix.make("Navix-Empty-16x16-v0")
    first = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.PRNGKey(0), num_envs))

    return _scanned(jax.vmap(env.step), first, len(env.action_set), num_envs)


def jumanji_batch(num_envs: int) -> Steps:
    """Jumanji's maze, the nearest that it has to a robot among obstacles."""
    import jumanji
    from jumanji.wrappers import VmapAutoResetWrapper

    env = VmapAutoResetWrapper(jumanji.make("Maze-v0"))
    first, _ = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), num_envs))

    return _scanned(lambda state, action: env.step(state, action)[0], first, 4, num_envs)


def _scanned(step: Callable[[Any, Any], Any], first: Any, actions: int, num_envs: int) -> Steps:
    """Repeated runs of a compiled loop of `STRIDE` steps under random actions."""

    def move(state: Any, action: Any) -> tuple[Any, Any]:
        return step(state, action), jnp.zeros(())  # scan wants an output beside the state

    def several_steps(state: Any, key: Any) -> Any:
        chosen = jax.random.randint(key, (STRIDE, num_envs), 0, actions)
        return jax.lax.scan(move, state, chosen)[0]

    stride = jax.jit(several_steps)
    state = first
    key = jax.random.PRNGKey(1)

    def steps(calls: int) -> int:
        nonlocal state, key
        strides = -(-calls // STRIDE)

        for _ in range(strides):
            key, own = jax.random.split(key)
            state = stride(state, own)

        jax.block_until_ready(state)  # JAX returns before it has computed

        return strides * STRIDE * num_envs

    return steps
