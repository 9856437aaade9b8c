"""`estimated_anew`: the data of the page of unseen scenes, every interval from what is kept."""

from collections.abc import Mapping, Sequence
from typing import Any

from agents.runs.pretrained import MODELS, Models
from eval.unseen.scene_scores import SceneScores, means_over_seeds

SCORES = "generalisation.npz"  # beside generalisation.json
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
