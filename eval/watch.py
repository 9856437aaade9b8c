"""`python -m eval watch`: a policy on its way, in the terminal, in a window or as an animated GIF."""

import sys
import time
from dataclasses import replace
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

from agents.algorithms import ALGORITHMS
from agents.checkpoint import Run, write_file
from agents.heuristics import REFERENCES
from agents.policy import Policy
from agents.pretrained import load_pretrained
from agents.rollout import Episode, arguments_of, roll_out
from eval.animate import as_gif, film
from irs_gym.task import Task

LAST_LINES = 2  # of a frame in text: its legend


def main(
    policy: Annotated[Positional[str], arg(metavar="ALGORITHM|RUN|POLICY", help_behavior_hint="")],
    target_db: float | None = None,
    phase_bits: int | None = None,
    irs_elements: int | None = None,
    human: bool = False,
    gif: Path | None = None,
    fps: int = 10,
    seed: int = 0,
) -> int:
    """Watch a policy on its way from the fixed start to the goal.

    Parameters
    ----------
    policy
        An algorithm with a pretrained model (ppo, dqn), a run folder, or a reference policy (oracle, greedy ...).
    target_db, phase_bits, irs_elements
        Where it plays; not with a run folder, whose agent plays where it was trained.
    human
        Whether to open a window instead of writing to the terminal.
    gif
        A file to write an animated GIF to instead.
    fps
        Steps a second.
    seed
        Seed of the random policies.
    """
    given = {"target_db": target_db, "phase_bits": phase_bits, "irs_elements": irs_elements}
    given = {name: value for name, value in given.items() if value is not None}
    mode = "rgb_array" if gif or human else "ansi"
    try:
        if not 1 <= fps <= 50:
            raise ValueError(f"fps={fps} must be an integer from 1 to 50")
        player, env = prepare(policy, given, mode, seed)
        if gif:
            frames, _ = film(player, env)
            write_file(gif, as_gif(frames, fps))
            print(f"written: {gif}")
            return 0
        episode = show_in_window(player, env, fps) if human else show(player, env, fps)
    except KeyboardInterrupt:
        return 130
    except DependencyNotInstalled:
        print("python -m eval watch: the window needs pygame: pip install pygame-ce", file=sys.stderr)
        return 2
    except (OSError, ValueError) as error:
        print(f"python -m eval watch: {error}", file=sys.stderr)
        return 2
    ended = "reached the goal" if episode.is_success else "did not reach the goal"
    print(f"{ended} after {episode.distance:.3f} m; the oracle needs {episode.oracle_distance:.3f} m")
    return 0


def prepare(name: str, given: dict[str, Any], mode: str, seed: int) -> tuple[Policy, gymnasium.Env[Any, Any]]:
    """The policy of that name, and an environment for it that renders in a mode.

    Raises
    ------
    OSError
        Where a file cannot be read.
    ValueError
        Where there is no such policy, or it does not play there.
    """
    if name in ALGORITHMS and not Path(name, "manifest.json").exists():
        pretrained = load_pretrained(name, **given)
        return pretrained, pretrained.make_env(mode)
    if name in REFERENCES:
        env = _env(Task(**given), mode)
        return REFERENCES[name](env, seed), env
    if not Path(name).exists():
        known = ", ".join([*ALGORITHMS, *REFERENCES])
        raise ValueError(f"{name!r} is neither a run folder nor one of {known}")
    if given:
        raise ValueError(f"{', '.join(given)} cannot be given along with a run: its agent plays where it was trained")
    run = Run.open(name)
    return run.load_model(), _env(run.task, mode)


def show(policy: Policy, env: gymnasium.Env[Any, Any], fps: int) -> Episode:
    """Play an episode in the terminal; where the output goes elsewhere, only the last frame is written."""
    console = Console()
    if not console.is_terminal:
        episode = roll_out(policy, env)
        print(env.render())
        return episode
    with Live(console=console, auto_refresh=False) as live:

        @wraps(policy.predict)
        def predict(*observation: Any, **settings: Any) -> Any:
            _draw(env, live)
            time.sleep(1 / fps)
            return policy.predict(*observation, **settings)

        episode = roll_out(SimpleNamespace(predict=predict), env)
        _draw(env, live)
    return episode


def show_in_window(policy: Policy, env: gymnasium.Env[Any, Any], fps: int) -> Episode:
    """Play an episode in a window, which stays open for a second."""
    env.metadata = {**env.metadata, "render_fps": fps}
    window = HumanRendering(env)
    episode = roll_out(policy, window)
    time.sleep(1)
    window.close()
    return episode


def _draw(env: gymnasium.Env[Any, Any], live: Live) -> None:
    frame: Any = env.render()
    live.update(Text(fit(frame, live.console.height - 1), no_wrap=True), refresh=True)


def fit(frame: str, height: int) -> str:
    """A frame in text, cut to the rows around the robot where it is higher than so many lines."""
    lines = frame.splitlines()
    if len(lines) <= height:
        return frame
    head, rows, legend = lines[:1], lines[1:-LAST_LINES], lines[-LAST_LINES:]
    room = max(1, height - 1 - LAST_LINES)
    robot = next(n for n, row in enumerate(rows) if "R" in row)
    first = min(max(0, robot - room // 2), len(rows) - room)
    return "\n".join([*head, *rows[first : first + room], *legend])


def _env(task: Task, mode: str) -> gymnasium.Env[Any, Any]:
    return gymnasium.make("irs_gym:IrsNav-v0", render_mode=mode, **arguments_of(replace(task, random_start=False)))
