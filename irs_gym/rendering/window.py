"""`Window`: one window that shows all the environments of a vector side by side."""

from math import ceil, sqrt
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.wrappers import HumanRendering
from numpy.typing import NDArray

_LARGEST = 1200  # pixels: a larger picture of all is thinned out to about this


class Window(VectorWrapper[Any, Any, Any, Any, Any]):
    """Shows each step of a vector environment; what `gymnasium.wrappers.HumanRendering` is to one,
    and by means of it.

    Gymnasium's own wrapper for vectors needs OpenCV besides pygame.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        """Show what ``env`` renders as ``"rgb_array"``."""
        super().__init__(env)
        self._window = HumanRendering(_Mosaic(env))

    @property
    def render_mode(self) -> str:  # type: ignore[override]
        """Always ``"human"``."""
        return "human"

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes as the environment does, and show them."""
        outcome = self.env.reset(seed=seed, options=options)
        self._window.reset()
        return outcome

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Move every robot once, and show it."""
        outcome = self.env.step(actions)
        self._window.step(0)
        return outcome

    def render(self) -> None:
        """Nothing: `reset` and `step` show it all."""

    def close(self, **kwargs: Any) -> None:
        """Close the window and the environment."""
        self._window.close()  # type: ignore[no-untyped-call]
        self.env.close(**kwargs)


class _Mosaic(gymnasium.Env[Any, Any]):
    """The pictures of a vector's environments as that of one, for a wrapper that shows one."""

    render_mode = "rgb_array"

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        self._envs = envs
        self.metadata = envs.metadata

    def reset(self, **_: Any) -> tuple[None, dict[str, Any]]:
        return None, {}

    def step(self, action: Any) -> tuple[None, float, bool, bool, dict[str, Any]]:
        return None, 0.0, False, False, {}

    def render(self) -> Any:
        return mosaic(np.stack([np.asarray(frame) for frame in self._envs.render() or ()]))


def mosaic(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pictures ``(n, H, W, 3)`` row by row in one, about as many rows as columns, white where there
    is none.
    """
    count, height, width, channels = frames.shape
    columns = ceil(sqrt(count))
    rows = ceil(count / columns)

    tiles = np.full((rows * columns, height, width, channels), 255, dtype=np.uint8)
    tiles[:count] = frames

    # Bring each tile's rows of pixels beside those of its neighbours before they become one row.
    whole = tiles.reshape(rows, columns, height, width, channels).swapaxes(1, 2)
    whole = whole.reshape(rows * height, columns * width, channels)

    every = ceil(max(whole.shape) / _LARGEST)

    return np.ascontiguousarray(whole[::every, ::every])
