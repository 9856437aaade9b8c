"""`python -m eval animate`: an episode of a policy as an animated GIF."""

import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium.wrappers import RenderCollection
from numpy.typing import NDArray
from PIL import Image
from tyro.conf import Positional, arg

from agents.rollout.episode import roll_out
from eval.load_policy import AT_HOME, LoadedPolicy, Place, load_policy
from irs_gym.files import write_file

LAST_MS = 2000  # the last frame stays


def main(
    policy: Annotated[Positional[str], arg(metavar="ALGORITHM|RUN|POLICY", help_behavior_hint="")],
    place: Annotated[Place, arg(name="")] = AT_HOME,
    out: Path | None = None,
    model: Literal["best", "last"] = "best",
    seed: int = 0,
    fps: int = 10,
) -> int:
    """Write an episode from the start to the goal as an animated GIF.

    Parameters
    ----------
    policy
        An algorithm with a pretrained model (ppo, dqn, planner, explorer ...), a run folder, the
        file of a network, or a reference policy (oracle, replanning, greedy, greedy_margin,
        masked_random, random).
    place
        Where it plays.
    out
        The file; by default animation.gif in the run folder, or a file named by the policy here.
    model
        Whether the best or the last state of a run's agent plays.
    seed
        Seed of the random policies.
    fps
        Steps a second.
    """
    try:
        check_fps(fps)
        found = load_policy(policy, place, "rgb_array", model=model, seed=seed)
        path = out or (
            Path(policy, "animation.gif")
            if Path(policy).is_dir()
            else Path(f"{Path(policy).stem}.gif")
        )
        frames, summary = film(found)
        write_file(path, as_gif(frames, fps))
    except (OSError, ValueError) as error:
        print(f"python -m eval animate: {error}", file=sys.stderr)
        return 2

    print(f"{summary}; written: {path}")
    return 0


def check_fps(fps: int) -> None:
    """Raise ``ValueError`` where that many steps a second cannot be shown."""
    if not 1 <= fps <= 50:
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
    content = BytesIO()
    pictures[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=[round(1000 / fps)] * (len(pictures) - 1) + [LAST_MS],
        loop=0,
    )

    return content.getvalue()
