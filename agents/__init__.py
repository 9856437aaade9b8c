"""Policies for the environment: reference rules, configured learners, and the run folders that hold
them.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.runs.pretrained import load_pretrained as load_pretrained

__all__ = ["load_pretrained"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'agents' has no attribute {name!r}")

    from agents.runs import pretrained  # on first use, so that `import agents` costs nothing

    return getattr(pretrained, name)
