"""`Policy`: what can be rolled out and scored, the `predict` of Stable-Baselines3."""

from inspect import signature
from typing import Any, Protocol

from numpy.typing import NDArray


class Policy(Protocol):
    """A rule that chooses actions from observations; models of Stable-Baselines3 are policies."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Actions, shape ``()`` for one observation or ``(n,)`` for a batch, and the next state of
        the policy; where the robot goes anywhere on the floor, ``(2,)`` or ``(n, 2)``.

        Parameters
        ----------
        observation
            One observation of the environment, or a batch along the first axis.
        state, episode_start
            Memory of recurrent policies and where it is cleared; others return ``state`` as it is.
        deterministic
            Whether to take the likeliest action instead of drawing one.
        """
        ...


def takes_masks(policy: Policy) -> bool:
    """Whether ``predict`` needs ``action_masks``, as that of sb3-contrib's MaskablePPO does."""
    return "action_masks" in signature(policy.predict).parameters
