"""`verify`: a submission's episodes played anew in their environment, and accepted or refused."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from agents.policies.policy import Policy
from agents.rollout.episode import TOLERANCE, roll_out
from eval.leaderboard.submission import (
    MADE,
    REFUSED,
    Agent,
    Episode,
    Refusal,
    Scores,
    Submission,
)
from eval.leaderboard.track import SEED, TRACKS, Track
from irs_gym.grid import MOVE_NAMES, MOVES

INFOS = ["distance", "is_refused", "is_success", "spl", "oracle_distance"]


@dataclass(frozen=True)
class Outcome:
    """What came of an episode, by its replay."""

    is_success: bool
    distance: float
    oracle_distance: float
    spl: float
    refused: int

    @property
    def ratio(self) -> float:
        """Distance over the oracle's."""
        return self.distance / self.oracle_distance

    @property
    def is_optimal(self) -> bool:
        """Whether the goal was reached over a path as short as the oracle's."""
        return self.is_success and self.ratio <= 1.0 + TOLERANCE


@dataclass(frozen=True)
class Verified:
    """A submission that was played anew."""

    submission: Submission
    track: Track
    outcomes: tuple[Outcome, ...]

    @property
    def scores(self) -> Scores:
        """Over all episodes."""
        return scores_of(self.outcomes)


def verify(submission: Submission, tracks: Mapping[str, Track] = TRACKS) -> Verified:
    """Play a submission anew, step by step in the environment itself.

    Raises
    ------
    Refusal
        Where it is of no track, its scenes are not the track's, or anything that it says is not so;
        the message names the scene and the step at fault.
    """
    track = _checked_track(submission, tracks)
    _check_scenes(submission, track)
    env = track.make_env(observation="cell", infos=INFOS)
    outcomes = tuple(_replayed(env, track, each) for each in submission.episodes)
    found = Verified(submission, track, outcomes)
    _check_scores(submission.scores, found.scores)

    return found


def submission_of(track: Track, actions: Iterable[Iterable[int]], agent: Agent) -> Submission:
    """The submission of an agent that did these actions in each scene of a track, in order.

    Parameters
    ----------
    actions
        For each scene, numbers from 0 to 7; refused moves are told by the environment.

    Raises
    ------
    ValueError
        Where there are fewer lists than scenes or more, or an episode is not over after the last of
        its actions, or before.
    """
    env = track.make_env(observation="cell", infos=INFOS)
    episodes = []
    outcomes = []

    for (scene, digest), own in zip(track.scenes.items(), actions, strict=True):
        env.reset(seed=SEED, options=track.options(scene))
        text = "".join(_letter(env.step(int(action))[-1], int(action)) for action in own)
        episode = Episode(scene=scene, sha256=digest, actions=text, is_success=False, distance=0.0)
        outcome = _played(env, track, episode)
        outcomes.append(outcome)
        claims = {"is_success": outcome.is_success, "distance": outcome.distance}
        episodes.append(episode.model_copy(update=claims))

    return Submission(
        format_version=1,
        track=track.name,
        env_id=track.env_id,
        arguments=dict(track.arguments),
        seed=SEED,
        agent=agent,
        episodes=tuple(episodes),
        scores=scores_of(outcomes),
    )


def play(track: Track, policy: Policy, **others: Any) -> list[list[int]]:
    """The actions of a policy in each scene of a track, for `submission_of`.

    ``others`` are the arguments of the environment that say what the policy sees, such as
    ``observation="flat"``.
    """
    env = track.make_env(**others)
    episodes = (
        roll_out(policy, env, seed=SEED, options=track.options(scene)) for scene in track.scenes
    )
    return [each.actions.tolist() for each in episodes]


def scores_of(outcomes: Iterable[Outcome]) -> Scores:
    """Scores over episodes, one or more."""
    every = list(outcomes)
    ratios = [each.ratio for each in every if each.is_success]

    return Scores(
        success=len(ratios) / len(every),
        spl=float(np.mean([each.spl for each in every])),
        ratio=float(np.mean(ratios)) if ratios else None,
        optimal=sum(each.is_optimal for each in every),
    )


def _checked_track(submission: Submission, tracks: Mapping[str, Track]) -> Track:
    if submission.track not in tracks:
        raise Refusal(f"track: {submission.track!r} is none of {', '.join(tracks)}")

    track = tracks[submission.track]
    wanted = {"env_id": track.env_id, "arguments": dict(track.arguments), "seed": SEED}

    for name, value in wanted.items():
        # as JSON, in which 1, 1.0 and true are three values
        found = json.dumps(getattr(submission, name), sort_keys=True)
        if found != json.dumps(value, sort_keys=True):
            raise Refusal(f"{name}: {found[:300]} is not that of {track.name}: {json.dumps(value)}")

    return track


def _check_scenes(submission: Submission, track: Track) -> None:
    """Refuse scenes that are not the track's, once each and in their order."""
    names = [each.scene for each in submission.episodes]
    seen: set[str] = set()

    for episode in submission.episodes:
        wanted = track.scenes.get(episode.scene)
        if wanted is None:
            raise Refusal(f"scene {episode.scene!r}: it is none of the track's")
        if episode.scene in seen:
            raise Refusal(f"scene {episode.scene!r}: it stands twice")
        if episode.sha256 != wanted:
            raise Refusal(
                f"scene {episode.scene!r}: its SHA-256 begins with {wanted}, not {episode.sha256}"
            )
        seen.add(episode.scene)

    missing = [each for each in track.scenes if each not in seen]
    if missing:
        raise Refusal(f"scene {missing[0]!r}: it is missing, as are {len(missing) - 1} others")
    if names != list(track.scenes):
        first = next(n for n, each in enumerate(track.scenes) if names[n] != each)
        raise Refusal(f"scene {names[first]!r}: it stands out of order")


def _replayed(env: gymnasium.Env[Any, Any], track: Track, episode: Episode) -> Outcome:
    """What comes of an episode; `Refusal` where that is not what is claimed."""
    outcome = _played(env, track, episode)
    steps = len(episode.actions)
    if outcome.is_success is not episode.is_success:
        said = "reaches" if outcome.is_success else "does not reach"
        raise Refusal(
            f"scene {episode.scene!r}, step {steps}: the robot {said} the goal, "
            f"and is_success={episode.is_success} is claimed"
        )
    if not _is_close(outcome.distance, episode.distance):
        raise Refusal(
            f"scene {episode.scene!r}, step {steps}: the robot has travelled "
            f"{outcome.distance!r} m, and distance={episode.distance!r} is claimed"
        )

    return outcome


def _played(env: gymnasium.Env[Any, Any], track: Track, episode: Episode) -> Outcome:
    """What comes of an episode, whatever is claimed of its end."""
    _, start = env.reset(seed=SEED, options=track.options(episode.scene))
    is_over = False
    info = start
    refused = 0

    for step, letter in enumerate(episode.actions, start=1):
        where = f"scene {episode.scene!r}, step {step}"
        if is_over:
            raise Refusal(f"{where}: the episode was over after step {step - 1}")

        action = (MADE.find(letter) + 1 or REFUSED.find(letter) + 1) - 1
        if action < 0:
            raise Refusal(f"{where}: {letter!r} is no action (0 to 7, and a to h if refused)")

        _, _, is_terminated, is_truncated, info = env.step(action)
        is_over = is_terminated or is_truncated
        refused += info["is_refused"]
        if _letter(info, action) != letter:
            said = f"is refused, {_why(env, action)}" if info["is_refused"] else "is made"
            claimed = "made" if info["is_refused"] else "refused"
            raise Refusal(
                f"{where}: the move {MOVE_NAMES[action]} {said}; it is said to be {claimed}"
            )

    if not is_over:
        raise Refusal(
            f"scene {episode.scene!r}, step {len(episode.actions)}: the list ends, "
            f"and the episode does not"
        )

    return Outcome(
        is_success=bool(info["is_success"]),
        distance=float(info["distance"]),
        oracle_distance=float(start["oracle_distance"]),
        spl=float(info["spl"]),
        refused=refused,
    )


def _letter(info: Mapping[str, Any], action: int) -> str:
    """How a step is written."""
    return (REFUSED if info["is_refused"] else MADE)[action]


def _why(env: gymnasium.Env[Any, Any], action: int) -> str:
    """Why a move from the robot's cell is refused."""
    robot: Any = env.unwrapped
    ahead = tuple((np.array(robot.path[-1]) + MOVES[action]).tolist())
    if not robot.radio_map.grid.has(ahead):
        return f"as {ahead} lies off the map"

    gain_db = float(robot.radio_map.gain_db[ahead])
    if gain_db == -np.inf:
        return f"as {ahead} lies in an obstacle"

    return f"as {ahead} has {gain_db:.3f} dB, below the target of {robot.world.target_db:.3f} dB"


def _check_scores(claimed: Scores, found: Scores) -> None:
    for name in Scores.model_fields:
        said = getattr(claimed, name)
        value = getattr(found, name)
        if (said is None) != (value is None) or (said is not None and not _is_close(said, value)):
            raise Refusal(f"scores.{name}: {said!r} is claimed, and replay gives {value!r}")


def _is_close(one: float, other: float) -> bool:
    """Whether two figures are equal but for the rounding of sums."""
    return abs(one - other) <= TOLERANCE * max(1.0, abs(other))
