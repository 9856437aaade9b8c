"""`python -m eval animate`: an episode of a run's policy, or of a reference policy, as an animated GIF."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from gymnasium.wrappers import RenderCollection
from numpy.typing import NDArray
from PIL import Image
from tyro.conf import Positional, arg

from agents.checkpoint import Run, write_file
from agents.heuristics import REFERENCES
from agents.policy import Policy
from agents.rollout import arguments_of, roll_out
from irs_gym.task import Task

ENV_ID = "irs_gym:IrsNav-v0"
LAST_MS = 2000  # the last frame stays


def main(
    policy: Annotated[Positional[str], arg(metavar="RUN|POLICY", help_behavior_hint="")],
    out: Path | None = None,
    model: Literal["best", "last"] = "best",
    scene: str | None = None,
    target_db: float | None = None,
    seed: int = 0,
    fps: int = 10,
) -> int:
    """Write an episode from the fixed start as an animated GIF.

    Parameters
    ----------
    policy
        A run folder, or a reference policy: oracle, replanning, greedy, greedy_margin, masked_random or random.
    out
        The file; by default animation.gif in the run folder, or POLICY.gif here.
    model
        Whether the best or the last state of a run's agent plays.
    scene, target_db
        Where a reference policy plays, in place of the defaults; a run's agent plays where it was trained.
    seed
        Seed of the random policies.
    fps
        Steps a second.
    """
    given = {name: value for name, value in (("scene", scene), ("target_db", target_db)) if value is not None}
    try:
        if not 1 <= fps <= 50:
            raise ValueError(f"fps={fps} must be an integer from 1 to 50")
        if policy in REFERENCES:
            env = _env(Task(**given))
            player, path = REFERENCES[policy](env, seed), out or Path(f"{policy}.gif")
        elif given:
            raise ValueError(f"{', '.join(given)} cannot be given along with a run, which plays where it was trained")
        else:
            run = Run.open(policy)
            env = _env(run.task)
            player, path = run.load_model(model), out or run.folder / "animation.gif"
        frames, summary = film(player, env)
        write_file(path, as_gif(frames, fps))
    except (OSError, ValueError) as error:
        print(f"python -m eval animate: {error}", file=sys.stderr)
        return 2
    print(f"{summary}; written: {path}")
    return 0


def film(policy: Policy, env: gymnasium.Env[Any, Any]) -> tuple[list[NDArray[np.uint8]], str]:
    """Pictures of an episode, the first before any move, and what came of it in words."""
    camera: Any = RenderCollection(env)
    episode = roll_out(policy, camera)
    ended = "reached the goal" if episode.is_success else "did not reach the goal"
    summary = f"{ended} after {episode.distance:.3f} m, the oracle needs {episode.oracle_distance:.3f} m"
    return camera.render(), summary


def as_gif(frames: Sequence[NDArray[np.uint8]], fps: int) -> bytes:
    """Pictures ``(H, W, 3)`` as an animated GIF; all share the colours of the last, which has every colour."""
    colours = Image.fromarray(frames[-1]).quantize(256, dither=Image.Dither.NONE)
    pictures = [Image.fromarray(each).quantize(palette=colours, dither=Image.Dither.NONE) for each in frames]
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


def _env(task: Task) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(ENV_ID, render_mode="rgb_array", **arguments_of(replace(task, random_start=False)))
