"""`film`: an episode of a policy as pictures; `as_gif`: pictures as an animated GIF."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from gymnasium.wrappers import RenderCollection
from numpy.typing import NDArray
from PIL import Image

from agents.rollout.episode import roll_out
from eval.load_policy import LoadedPolicy

LAST_MS = 2000  # the last frame stays


def check_fps(fps: int) -> None:
    """Raise ``ValueError`` where that many steps a second cannot be shown."""
    if not 1 <= fps <= 50:  # a GIF counts in hundredths of a second, and browsers slow down below 2
        raise ValueError(f"fps={fps} must be an integer from 1 to 50")


def film(found: LoadedPolicy) -> tuple[list[NDArray[np.uint8]], str]:
    """Pictures of an episode, the first before any move, and what came of it in words."""
    camera: Any = RenderCollection(found.env)
    episode = roll_out(found.policy, camera, options=found.options)
    ended = "reached the goal" if episode.is_success else "did not reach the goal"
    summary = (
        f"{ended} after {episode.distance:.3f} m, the oracle needs {episode.oracle_distance:.3f} m"
    )

    return camera.render(), summary


def as_gif(frames: Sequence[NDArray[np.uint8]], fps: int) -> bytes:
    """Pictures ``(H, W, 3)`` as an animated GIF; all share the colours of the last, which has every
    colour.
    """
    colours = Image.fromarray(frames[-1]).quantize(256, dither=Image.Dither.NONE)
    pictures = [
        Image.fromarray(each).quantize(palette=colours, dither=Image.Dither.NONE) for each in frames
    ]
    durations_ms = [round(1000 / fps)] * (len(pictures) - 1) + [LAST_MS]

    content = BytesIO()
    pictures[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=durations_ms,
        loop=0,
    )

    return content.getvalue()
