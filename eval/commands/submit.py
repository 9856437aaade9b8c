"""`python -m eval submit`: an agent's episodes on tracks of the leaderboard, to hand in."""

import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

import irs_gym
from agents.registry import ALGORITHMS, generalists
from agents.rollout.episode import roll_out
from agents.rollout.scene_set import NOTHING
from agents.runs.pretrained import MODELS, Models
from agents.runs.problem import problem_of
from agents.runs.run_folder import Run
from eval.leaderboard.replay import submission_of
from eval.leaderboard.submission import Agent, save
from eval.leaderboard.track import Track, track_of
from eval.load_policy import AT_HOME, Place, load_policy
from eval.unseen.policy_results import REFERENCE_TITLES
from eval.unseen.scores import player_of, run_or_player
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.mdp.task import Task, task_of


def main(
    agents: Annotated[
        Positional[tuple[str, ...]], arg(metavar="RUN|MODEL [...]", help_behavior_hint="")
    ],
    track: tuple[str, ...],
    authors: str,
    name: str | None = None,
    version: str | None = None,
    out: Path = Path("submissions"),
) -> int:
    """Write a submission for each agent on each track: OUT/TRACK/AGENT.json.gz.

    A file holds what was done in each scene, and what is claimed to have come of it. `python -m
    eval verify` plays it anew; `docs/leaderboard.md` tells the format, and how an agent of your own
    is submitted.

    Parameters
    ----------
    agents
        Run folders, pretrained models (ppo, dqn, planner, explorer ...), files of networks, and
        reference policies (oracle, replanning, greedy ...).
    track
        What to play: paper-61.8dB-continuous, test-map, test-local ...; for a name that is none,
        all are listed.
    authors
        Who is to be named.
    name
        What one agent is to be called; by default the title of its algorithm.
    version
        Of the agent; by default that of irs_gym.
    out
        Folder of the files.
    """
    try:
        if not agents or not track:
            raise ValueError("name one agent or more, and a track")
        if name is not None and len(agents) > 1:
            raise ValueError(f"name={name!r} cannot be given to {len(agents)} agents")

        # all of it before anything is played
        said = Agent(name=name or "agent", authors=authors, version=version or "0", commit=None)
        tracks = [track_of(each) for each in track]

        for each in tracks:
            for policy in agents:
                title, commit = _origin(policy, each)
                agent = Agent(
                    name=name or title,
                    authors=said.authors,
                    version=version or irs_gym.__version__,
                    commit=commit,
                )
                file = out / each.name / f"{_slug(policy)}.json.gz"
                submission = submission_of(each, _actions(policy, each), agent)
                save(submission, file)

                scores = submission.scores
                print(
                    f"{file}: success {scores.success:.4f}, SPL {scores.spl:.4f}, "
                    f"{scores.optimal} of {len(submission.episodes)} optimal",
                    flush=True,
                )
    except (OSError, ValueError) as error:
        print(f"python -m eval submit: {error}", file=sys.stderr)
        return 2

    return 0


def _actions(name: str, track: Track) -> list[list[int]]:
    """What an agent does in each scene of a track; a ``ValueError`` where it does not play
    there.
    """
    if track.split is None:
        return [_on_paper(name, track)]

    found = run_or_player(name)
    player = player_of(found) if isinstance(found, Run) else found
    if track.sees == "patch" and player.sees != "local":
        raise ValueError(f"{name!r} sees the whole map, and {track.name} is for what sees a patch")

    count: Any = track.arguments["num_scenes"]
    done = player.episodes(build_scene_set(track.split, count)).actions
    if done is None:
        raise ValueError(f"{name!r} keeps no actions")

    return [row[row != NOTHING].tolist() for row in done]


def _on_paper(name: str, track: Track) -> list[int]:
    """What an agent does in the paper's scene, observed as it was trained to."""
    known = {each.name for each in fields(Place)}
    arguments: dict[str, Any] = {
        key: value for key, value in track.arguments.items() if key in known
    }
    place = Place(**arguments)
    run = _run(name)
    if run is not None and not run.is_generalist:
        own = problem_of(run.task)
        asked = problem_of(task_of(arguments))
        if own != asked:
            raise ValueError(f"{name!r} learned at {own.label}, and {track.name} is {asked.label}")
        place = AT_HOME

    found = load_policy(name, place, None)
    actions: list[int] = roll_out(found.policy, found.env, options=found.options).actions.tolist()

    return actions


def _run(name: str) -> Run | None:
    """The run folder of that name; None where there is none."""
    return Run.open(name) if Path(name, "manifest.json").exists() else None


def _origin(name: str, track: Track) -> tuple[str, str | None]:
    """What an agent is called, and the commit that trained it, where it was trained."""
    run = _run(name)
    if run is not None:
        return ALGORITHMS[run.config.algorithm].title, run.manifest.commit
    if name not in ALGORITHMS:  # a reference, or the file of a network
        return REFERENCE_TITLES.get(name, Path(name).stem), None

    models = Models.read(MODELS)
    if name in generalists():
        return ALGORITHMS[name].title, models.find_generalist(name).commit

    if track.split is not None:
        raise ValueError(f"{name!r} learned in one scene: it plays no {track.name}")

    arguments = {key: value for key, value in track.arguments.items() if key in vars(Task())}

    return ALGORITHMS[name].title, models.find(name, task_of(arguments)).commit


def _slug(name: str) -> str:
    """The name of an agent as that of a file."""
    return re.sub(r"[^\w.-]+", "-", Path(name).stem).strip("-.") or "agent"
