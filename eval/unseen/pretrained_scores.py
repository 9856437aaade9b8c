"""`score_pretrained`: what the pretrained models of ``models/`` do on a set of scenes, beside
references.
"""

from dataclasses import asdict
from functools import partial
from typing import Any

from agents.registry import ALGORITHMS, observation_of
from agents.rollout.scene_set import play_scene_set
from agents.runs.pretrained import MODELS, Models, load_pretrained
from eval.unseen.policy_results import REFERENCE_TITLES, Track, track_of
from eval.unseen.scores import HARD, Player, detours, reference, score_of
from irs_gym.datasets.scene_set import SceneSet


def score_pretrained(name: str, pool: SceneSet) -> dict[str, Any]:
    """Scores on all scenes of a set of that name and on the hard ones, as JSON holds them.

    There is one model of each algorithm: the best of several seeds on the validation scenes.
    """
    is_hard = detours(pool) > HARD
    rows: list[tuple[str, Track, int | None, Player]] = []

    for entry in Models.read(MODELS).generalists:
        algorithm: Any = entry.config.algorithm
        play = partial(
            play_scene_set,
            load_pretrained(algorithm).policy,
            observation=observation_of(algorithm),
        )
        title = ALGORITHMS[algorithm].title
        rows.append((title, track_of(algorithm), entry.chosen_among, Player(algorithm, play)))

    for rule, title in REFERENCE_TITLES.items():
        rows.append((title, "local", None, reference(rule)))

    return {
        "set": name,
        "scenes": len(pool),
        "hard": int(is_hard.sum()),
        "rows": [
            {"name": title, "track": track, "chosen_among": among, **_scores(player, pool, is_hard)}
            for title, track, among, player in rows
        ],
    }


def _scores(player: Player, pool: SceneSet, is_hard: Any) -> dict[str, Any]:
    episodes = player.episodes(pool)
    return {
        "all": asdict(score_of(episodes)),
        "hard": asdict(score_of(episodes, is_hard)),
    }
