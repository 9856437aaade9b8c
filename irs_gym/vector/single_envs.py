"""`SingleEnvs`: the environments of a vector one by one, with the methods that `SyncVectorEnv` has
for that.
"""

from collections.abc import Callable
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv

Make = Callable[[], gymnasium.Env[Any, Any]]
# of a robot: where it stands, and its path
Snapshots = Callable[[int], tuple[Any, list[Any]]]


class SingleEnvs:
    """Answers as n single environments would that are where the robots of the vector are.

    They are made on demand, and looked at only: to move one of them alone is refused.
    """

    MOVES = ("reset", "step", "close", "set_state", "take_over")
    ALIKE = ("metadata", "render_mode", "task")  # attributes that no episode changes

    def __init__(self, envs: VectorEnv[Any, Any, Any], make: Make, snapshot: Snapshots) -> None:
        """Environments that ``make`` makes, over the episodes of the robots of a vector."""
        self._envs = envs
        self._num_envs = envs.num_envs
        self._make = make
        self._snapshot = snapshot
        self._own: dict[str, list[Any]] = {}  # attributes that the user set

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What a method of each environment returns, or the value of an attribute.

        Raises ``AttributeError`` where there is none of that name, or where it would move one
        environment alone.
        """
        if name in self._own:
            return tuple(self._own[name])
        if name in self.MOVES:
            raise AttributeError(
                f"{name!r} moves single environments: call {name} of the vector environment"
            )
        if not hasattr(self._make(), name):
            raise AttributeError(
                f"single environments have no attribute {name!r}, and no method of that name"
            )

        return tuple(self._answer(i, name, args, kwargs) for i in range(self._num_envs))

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of the user's own in each environment: to a value, or to one of a list
        or tuple of n.

        Raises ``AttributeError`` for the environments' own attributes, and ``ValueError`` for a
        list of another length.
        """
        if not isinstance(values, list | tuple):
            values = [values] * self._num_envs

        if len(values) != self._num_envs:
            raise ValueError(f"values holds {len(values)} values for {self._num_envs} environments")
        if hasattr(self._make().unwrapped, name):
            raise AttributeError(
                f"{name!r} cannot be set: the environments share it, so make new ones"
            )

        self._own[name] = list(values)

    def _answer(self, i: int, name: str, args: Any, kwargs: Any) -> Any:
        env: Any = self._make().unwrapped
        env.spec = self._envs.spec
        if name not in self.ALIKE:
            env.take_over(*self._snapshot(i))

        value = getattr(env, name)

        return value(*args, **kwargs) if callable(value) else value
