"""`FrameCollection`: the pictures of each episode as a list, for vector environments."""

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from irs_gym.mdp.autoreset import AutoresetMode


class FrameCollection(VectorWrapper[Any, Any, Any, Any, Any]):
    """Collects a picture of every environment at each step; what
    `gymnasium.wrappers.RenderCollection` is to one.

    `render` gives each environment's pictures since its episode began or since the last call,
    whichever is later.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        """Collect what ``env`` renders."""
        super().__init__(env)
        self._frames: list[list[Any]] = [[] for _ in range(env.num_envs)]
        self._has_ended = np.zeros(env.num_envs, dtype=bool)

    @property
    def render_mode(self) -> str:  # type: ignore[override]
        """That of the environment, with ``_list`` behind it."""
        return f"{self.env.render_mode}_list"

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode, and its list anew, where the environment does."""
        outcome = self.env.reset(seed=seed, options=options)
        begun = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        self._has_ended &= ~begun
        self._collect(begun, begun)

        return outcome

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Move every robot once, and add a picture of each."""
        outcome = self.env.step(actions)
        _, _, terminated, truncated, _ = outcome

        # Where an episode has begun, its list does too: with next-step autoreset a step after the
        # end of the one before, with same-step autoreset at once.
        mode = self.metadata["autoreset_mode"]
        resumed = self._has_ended
        self._has_ended = terminated | truncated
        begun = {AutoresetMode.NEXT_STEP: resumed, AutoresetMode.SAME_STEP: self._has_ended}.get(
            mode
        )
        self._collect(np.ones_like(resumed), np.zeros_like(resumed) if begun is None else begun)

        return outcome

    def render(self) -> tuple[Any, ...]:
        """A list of pictures for each environment; the next call gives later ones alone."""
        frames = tuple(self._frames)
        self._frames = [[] for _ in frames]
        return frames

    def _collect(self, shown: NDArray[np.bool_], begun: NDArray[np.bool_]) -> None:
        """Add a picture where one is shown, to a new list where an episode has begun."""
        for i, frame in enumerate(self.env.render() or ()):
            if begun[i]:
                self._frames[i] = []

            if shown[i]:
                self._frames[i].append(frame)
