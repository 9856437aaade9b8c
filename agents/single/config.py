"""`Sb3Config`: what the settings of the algorithms of Stable-Baselines3 have in common; and checks
of settings.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, ClassVar, Literal, Protocol

Kind = Literal["whole", "positive", "share", "weight", "finite", "log_std"]
_KINDS: dict[Kind, tuple[Callable[[Any], bool], str]] = {
    "whole": (lambda value: value >= 1, "be a positive integer"),
    "positive": (lambda value: 0 < value < float("inf"), "be a positive number"),
    "share": (lambda value: 0 <= value <= 1, "be a number from 0 to 1"),
    "weight": (lambda value: 0 <= value < float("inf"), "not be negative"),
    "finite": (isfinite, "be a finite number"),
    "log_std": (lambda value: -20 <= value <= 2, "be a number from -20 to 2"),  # as in SB3's SAC
}


class Sb3Config(Protocol):
    """Settings of an algorithm of Stable-Baselines3 under its own names, so that each is handed on
    as it is.
    """

    algorithm: ClassVar[str]
    policy_settings: ClassVar[tuple[str, ...]]
    """Fields that are handed on to the networks."""
    env_settings: ClassVar[tuple[str, ...]]
    """Fields that are handed on to the environment."""

    @property
    def net_arch(self) -> tuple[int, ...]:
        """Widths of the hidden layers of each network."""
        ...

    @property
    def signs(self) -> bool:
        """Whether networks are told the signs of what is observed."""
        ...


def check_settings(settings: Any, kind: Kind, *names: str) -> None:
    """Raise a ``ValueError`` that names the first of these fields that is not of the kind."""
    is_right, wanted = _KINDS[kind]

    for name in names:
        if not is_right(getattr(settings, name)):
            raise ValueError(f"{name}={getattr(settings, name)} must {wanted}")


def check_schedule(settings: Any) -> None:
    """Raise a ``ValueError`` that names a field out of its range, of those that every algorithm in
    environments has.
    """
    check_settings(settings, "whole", "total_timesteps", "n_envs")
    check_settings(settings, "positive", "learning_rate", "final_learning_rate")
    check_settings(settings, "share", "gamma")


def check_widths(settings: Sb3Config) -> None:
    """Raise a ``ValueError`` where a layer has no width."""
    if any(width < 1 for width in settings.net_arch):
        raise ValueError(f"net_arch={settings.net_arch} must hold positive widths")
