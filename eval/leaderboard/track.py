"""`TRACKS`: what a submission may be for: an environment, its arguments, and a set of scenes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import gymnasium

from irs_gym.datasets.splits import digest, frozen, split_of
from irs_gym.radio.scene import load_scene

Argument = str | int | float | bool | None
SEED = 0  # of each reset; no track draws anything, so that it changes nothing


@dataclass(frozen=True, kw_only=True)
class Track:
    """Episodes that agents are compared by: one from the start of each scene.

    Attributes
    ----------
    name
        Its name in files and on pages.
    env_id
        The environment, ``"IrsNav-v0"`` or ``"IrsNavRandom-v0"``.
    arguments
        Those of `gymnasium.make` that make the problem; what an agent observes is its own affair.
    sees
        Whether agents may see all, or by their word only the patch around the robot. A list of
        actions cannot tell.
    """

    name: str
    env_id: Literal["IrsNav-v0", "IrsNavRandom-v0"]
    arguments: Mapping[str, Argument]
    sees: Literal["all", "patch"] = "all"

    @property
    def split(self) -> str | None:
        """The split that the scenes are of; None for the paper's."""
        return None if self.env_id == "IrsNav-v0" else str(self.arguments["split"])

    @cached_property
    def scenes(self) -> Mapping[str, str]:
        """The start of the SHA-256 of each scene's JSON, by the scene's name, in order."""
        if self.split is None:
            scene = load_scene(str(self.arguments["scene"]))
            return {scene.name: digest(scene.model_dump_json().encode())}

        count: Any = self.arguments["num_scenes"]
        kept = frozen()[self.split].scenes[:count]

        return {f"{self.split}-{n}": each for n, each in enumerate(kept)}

    def make_env(self, **others: Any) -> gymnasium.Env[Any, Any]:
        """The environment, with other arguments that do not change the problem."""
        arguments: dict[str, Any] = {**self.arguments, **others}
        return gymnasium.make(f"irs_gym:{self.env_id}", **arguments)

    def options(self, scene: str) -> dict[str, Any] | None:
        """Options of a reset to a scene."""
        return None if self.split is None else {"scene_id": scene}


def paper_track(name: str, **arguments: Argument) -> Track:
    """The paper's scene from its own start, for a target and a panel."""
    whole: dict[str, Argument] = {"scene": "paper", **arguments, "max_episode_steps": 400}
    return Track(name=f"paper-{name}", env_id="IrsNav-v0", arguments=whole)


def split_track(split: str, sees: Literal["all", "patch"], num_scenes: int = 1000) -> Track:
    """The first scenes of a frozen split, each from its own start."""
    steps = max(400, 5 * sum(split_of(split).frame))  # as `eval` scores all policies
    arguments: dict[str, Argument] = {
        "split": split,
        "num_scenes": num_scenes,
        "max_episode_steps": steps,
    }
    kind = {"all": "map", "patch": "local"}[sees]

    return Track(name=f"{split}-{kind}", env_id="IrsNavRandom-v0", arguments=arguments, sees=sees)


_ALL = (
    paper_track("62.5dB-without-IRS", target_db=-62.5, irs_elements=0),
    paper_track("62.5dB-1-bit", target_db=-62.5, phase_bits=1),
    paper_track("61.8dB-1-bit", target_db=-61.8, phase_bits=1),
    paper_track("61.8dB-2-bit", target_db=-61.8, phase_bits=2),
    paper_track("62.5dB-continuous", target_db=-62.5),
    paper_track("61.8dB-continuous", target_db=-61.8),
    paper_track("61.2dB-continuous", target_db=-61.2),
    paper_track("60.0dB-continuous", target_db=-60.0),
    *(
        split_track(split, sees)
        for sees in ("all", "patch")
        for split in ("test", "ood-clutter", "ood-irs", "ood-size", "ood-rooms")
    ),
)
TRACKS: Mapping[str, Track] = {each.name: each for each in _ALL}
"""By their names, in the order of the page."""


def track_of(name: str, tracks: Mapping[str, Track] = TRACKS) -> Track:
    """A track by its name; a ``ValueError`` lists all for an unknown one."""
    if name not in tracks:
        raise ValueError(f"track={name!r} must be one of {', '.join(tracks)}")

    return tracks[name]
