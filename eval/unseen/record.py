"""`estimated_anew`: the data of the page of unseen scenes, every interval from what is kept;
`with_kept_rows`: rows of a page that is there.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.runs.pretrained import MODELS, Models
from eval.origin import merged
from eval.unseen.policy_results import is_point
from eval.unseen.scene_scores import SceneScores, key_of, means_over_seeds
from irs_gym.files import read_file

VERSION = 2
RECORD = "generalisation.json"
SCORES = "generalisation.npz"  # beside it
DATA_BYTES = 2**24  # of generalisation.json


def estimated_anew(record: Mapping[str, Any], scores: SceneScores) -> dict[str, Any]:
    """A record of `eval.commands.generalisation`, with all figures from the scores; those of
    earlier runs from the means of their seeds.

    Raises
    ------
    ValueError
        Where the scores are not those of the record.
    """
    entrants = record["entrants"]
    told = [{**each, "sets": scores.results(each, entrants)} for each in entrants]
    return {
        **record,
        "entrants": told,
        "left_out_families": left_out_families(told, scores),
        "shipped": shipped(told, scores),
        "earlier": [{**each, "sets": means_over_seeds(each)} for each in record["earlier"]],
    }


def read_record(file: Path) -> dict[str, Any]:
    """The data of a page.

    Raises
    ------
    OSError
        Where it cannot be read.
    ValueError
        Where it is damaged, or of another version of the page.
    """
    record = json.loads(read_file(file, DATA_BYTES))
    if not isinstance(record, dict) or record.get("format_version") != VERSION:
        raise ValueError(f"{str(file)!r} must be the data of a page of version {VERSION}")

    return record


def kept_rows(
    old: Mapping[str, Any],
    sets: Mapping[str, Any],
    is_anew: Callable[[Mapping[str, Any]], bool],
) -> list[dict[str, Any]]:
    """The rows of runs in the data of a page but those that there are new ones for; each says from
    which commit it was scored. On sets that the page did not have they have no score.

    Parameters
    ----------
    old
        The data.
    sets
        What each track is scored on, as in the data of a page.
    is_anew
        Whether there is a new row in place of one.

    Raises
    ------
    ValueError
        Where they are of other scenes.
    """
    rows = [
        {"scored_from": old["commit"], **each}
        for each in old["entrants"]
        if each["is_run"] and not is_anew(each)
    ]

    for each in rows:
        now = sets[each["track"]]
        if any(now.get(name) != one for name, one in old["sets"][each["track"]].items()):
            raise ValueError(
                f"the row {key_of(each)!r} cannot be kept: it is of other scenes of the "
                f"{each['track']} track, of which as many are needed as it has"
            )

    return rows


def with_kept_rows(
    record: Mapping[str, Any],
    scores: SceneScores,
    old: Mapping[str, Any],
    old_scores: SceneScores,
) -> tuple[dict[str, Any], SceneScores]:
    """A record and its scores with the rows of another that it has no runs for, as they are there;
    see `kept_rows`, also for what is raised.

    A model of ``models/`` that is one of their seeds, and was played on all sets, has no row of its
    own.
    """
    runs = [each for each in record["entrants"] if each["is_run"]]
    anew = {key_of(each) for each in runs}
    played = {model for each in runs for model in each["models"]}  # by whatever name
    rows = kept_rows(
        old, record["sets"], lambda row: key_of(row) in anew or {*row["models"]} <= played
    )
    models = {
        model
        for each in rows
        if not is_point(each["algorithm"], each["split"], each["training_scenes"])
        for model in each["models"]
    }
    others = [
        each
        for each in record["entrants"]
        if each["is_run"] or not each["models"] or not {*each["models"]} <= models
    ]

    origin = {
        name: merged(old[name], record[name]) if rows else record[name]
        for name in ("trained_with", "trained_from")
    }
    whole = {**record, "entrants": [*rows, *others], **origin}
    spl = {**old_scores.of_entrants(rows), **scores.of_entrants(others)}

    return whole, SceneScores(spl, scores.is_hard)


def left_out_families(
    entrants: Sequence[Mapping[str, Any]], scores: SceneScores
) -> list[dict[str, Any]]:
    """Agents that learned on all kinds of scenes but one family, in one for each family: how they
    do on that, and the mean over families.
    """
    groups: dict[str, dict[str, Mapping[str, Any]]] = {}
    for each in entrants:
        if each["family"] is not None:
            groups.setdefault(each["group"], {})[each["family"]] = each

    return [
        {
            "name": name,
            "algorithm": next(iter(by_family.values()))["algorithm"],
            "track": next(iter(by_family.values()))["track"],
            "families": {
                family: {**each["sets"][f"ood-{family}"]["all"], "seeds": each["seeds"]}
                for family, each in by_family.items()
            },
            "mean": scores.left_out(by_family, entrants),
        }
        for name, by_family in groups.items()
    ]


def shipped(entrants: Sequence[Mapping[str, Any]], scores: SceneScores) -> list[dict[str, Any]]:
    """The models of ``models/`` that are on a page, each with its own scores."""
    kept = {entry.sha256: entry for entry in Models.read(MODELS).generalists}
    rows = {
        sha256: (kept[sha256], entrant, place)
        # a row of its own has more sets than a point of a curve
        for entrant in sorted(entrants, key=lambda each: not each["is_run"])
        for place, sha256 in enumerate(entrant["models"])
        if sha256 in kept
    }
    order = list(kept)
    seeds = [rows[sha256] for sha256 in sorted(rows, key=order.index)]
    return [
        {
            "name": entrant["name"],
            "training_scenes": entrant["training_scenes"],
            "learned_on": entrant["learned_on"],
            "seed": entrant["seeds"][place],
            "seeds": len(entrant["seeds"]),
            "chosen_among": entry.chosen_among,
            "validation_spl": entry.spl,
            "spl": scores.own(entrant, place),
        }
        for entry, entrant, place in seeds
    ]
