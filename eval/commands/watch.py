"""`python -m eval watch`: a policy on its way, in the terminal, in a window or as a GIF."""

import sys
import time
from functools import wraps
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import gymnasium
from gymnasium.error import DependencyNotInstalled
from gymnasium.wrappers import HumanRendering
from rich.console import Console
from rich.live import Live
from rich.text import Text
from tyro.conf import Positional, arg

from agents.rollout.episode import EpisodeResult, roll_out
from eval.animation import as_gif, check_fps, film
from eval.load_policy import AT_HOME, LoadedPolicy, Place, load_policy
from irs_gym.files import write_file

LAST_LINES = 2  # of a frame in text: its legend


def main(
    policy: Annotated[Positional[str], arg(metavar="ALGORITHM|RUN|POLICY", help_behavior_hint="")],
    place: Annotated[Place, arg(name="")] = AT_HOME,
    human: bool = False,
    gif: Path | None = None,
    fps: int = 10,
    seed: int = 0,
) -> int:
    """Watch a policy on its way from the start to the goal.

    Parameters
    ----------
    policy
        An algorithm with a pretrained model (ppo, dqn, planner, explorer ...), a run folder, the
        file of a network, or a reference policy (oracle, replanning, greedy ...; with
        continuous, oracle, grid_oracle, straight, random).
    place
        Where it plays.
    human
        Whether to open a window instead of writing to the terminal.
    gif
        A file to write an animated GIF to instead.
    fps
        Steps a second.
    seed
        Seed of the random policies.
    """
    try:
        check_fps(fps)
        found = load_policy(policy, place, "rgb_array" if gif or human else "ansi", seed=seed)
        if gif:
            frames, _ = film(found)
            write_file(gif, as_gif(frames, fps))
            print(f"written: {gif}")
            return 0

        episode = show_in_window(found, fps) if human else show(found, fps)
    except DependencyNotInstalled:
        print(
            "python -m eval watch: the window needs pygame: pip install pygame-ce", file=sys.stderr
        )
        return 2
    except (OSError, ValueError) as error:
        print(f"python -m eval watch: {error}", file=sys.stderr)
        return 2

    ended = "reached the goal" if episode.is_success else "did not reach the goal"
    print(
        f"{ended} after {episode.distance:.3f} m; the oracle needs {episode.oracle_distance:.3f} m"
    )

    return 0


def show(found: LoadedPolicy, fps: int) -> EpisodeResult:
    """Play an episode in the terminal; where the output goes elsewhere, only the last frame is
    written.
    """
    console = Console()
    policy = found.policy
    env = found.env
    if not console.is_terminal:
        episode = roll_out(policy, env, options=found.options)
        print(env.render())
        return episode

    with Live(console=console, auto_refresh=False) as live:
        # The wrapper keeps the signature, by which `roll_out` tells whether masks are taken.
        @wraps(policy.predict)
        def predict(*observation: Any, **settings: Any) -> Any:
            _show_frame(env, live)
            time.sleep(1 / fps)
            return policy.predict(*observation, **settings)

        episode = roll_out(SimpleNamespace(predict=predict), env, options=found.options)
        _show_frame(env, live)

    return episode


def show_in_window(found: LoadedPolicy, fps: int) -> EpisodeResult:
    """Play an episode in a window, which stays open for a second."""
    found.env.metadata = {**found.env.metadata, "render_fps": fps}
    window: Any = HumanRendering(found.env)  # its `close` has no types
    episode = roll_out(found.policy, window, options=found.options)
    time.sleep(1)
    window.close()

    return episode


def _show_frame(env: gymnasium.Env[Any, Any], live: Live) -> None:
    frame: Any = env.render()
    live.update(Text(fit(frame, live.console.height - 1), no_wrap=True), refresh=True)


def fit(frame: str, height: int) -> str:
    """A frame in text, cut to the rows around the robot where it is higher than so many lines."""
    lines = frame.splitlines()
    if len(lines) <= height:
        return frame

    head = lines[:1]
    rows = lines[1:-LAST_LINES]
    legend = lines[-LAST_LINES:]
    room = max(1, height - 1 - LAST_LINES)
    robot = next(n for n, row in enumerate(rows) if "R" in row)
    first = min(max(0, robot - room // 2), len(rows) - room)

    return "\n".join([*head, *rows[first : first + room], *legend])
