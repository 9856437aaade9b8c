"""`python -m eval animate`: an episode of a policy as an animated GIF."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from eval.animation import as_gif, check_fps, film
from eval.load_policy import AT_HOME, Place, load_policy
from irs_gym.files import write_file


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
        masked_random, random; with continuous, oracle, grid_oracle, straight, random).
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
        path = out or _default_file(Path(policy))
        frames, summary = film(found)
        write_file(path, as_gif(frames, fps))
    except (OSError, ValueError) as error:
        print(f"python -m eval animate: {error}", file=sys.stderr)
        return 2

    print(f"{summary}; written: {path}")
    return 0


def _default_file(policy: Path) -> Path:
    """In the folder of a run, else named after the policy, here."""
    return policy / "animation.gif" if policy.is_dir() else Path(f"{policy.stem}.gif")
