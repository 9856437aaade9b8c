"""What the wheel holds beside `irs_gym`: agents, train, eval and the pretrained models, below
`irs_gym/_lab`, where `irs_gym.lab` finds them.

An editable install has them where they are.
"""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

LAB = ("agents", "train", "eval", "models")


class LabHook(BuildHookInterface):
    """Place the packages without a move of their source."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the files, but not for an editable install."""
        if version == "editable":
            return
        root = Path(self.root)
        build_data["force_include"] |= {
            str(file): f"irs_gym/_lab/{file.relative_to(root).as_posix()}"
            for name in LAB
            for file in sorted((root / name).rglob("*"))
            if file.is_file() and "__pycache__" not in file.parts
        }
