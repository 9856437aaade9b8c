"""`estimated_anew`: the data of the page of unseen scenes, every interval from what is kept."""

from collections.abc import Mapping, Sequence
from typing import Any

from agents.runs.pretrained import MODELS, Models
from eval.estimates import estimate_as_json
from eval.statistics import ONE_SEED, Estimate
from eval.unseen.scene_scores import BOTH, SEEDS, SceneScores, results_over_seeds

SCORES = "generalisation.npz"  # beside generalisation.json
DATA_BYTES = 2**24  # of generalisation.json


def estimated_anew(record: Mapping[str, Any], scores: SceneScores | None) -> dict[str, Any]:
    """A record of `eval.commands.generalisation`, with all figures from the scores; without them,
    with intervals from the means of the seeds.

    Raises
    ------
    ValueError
        Where the scores are not those of the record.
    """
    entrants = record["entrants"]
    told = [
        {
            **each,
            "sets": scores.results(each, entrants)
            if scores
            else results_over_seeds(each, entrants),
        }
        for each in entrants
    ]
    return {
        **record,
        "over": BOTH if scores else SEEDS,
        "entrants": told,
        "shipped": shipped(told, scores),
    }


def shipped(
    entrants: Sequence[Mapping[str, Any]], scores: SceneScores | None
) -> list[dict[str, Any]]:
    """The models of ``models/`` that are one of the seeds of a page, each with its own scores."""
    kept = {entry.sha256: entry for entry in Models.read(MODELS).generalists}
    seeds = [
        (kept[sha256], entrant, place)
        for entrant in entrants
        for place, sha256 in enumerate(entrant.get("models", ()))
        if sha256 in kept
    ]
    found = []

    for entry, entrant, place in seeds:
        own = (
            scores.own(entrant, place)
            if scores
            else {
                name: estimate_as_json(
                    Estimate(each["all"]["spl_by_seed"][place], None, None, ONE_SEED)
                )
                for name, each in entrant["sets"].items()
            }
        )
        found.append(
            {
                "name": entrant["name"],
                "training_scenes": entrant["training_scenes"],
                "seed": entrant["seeds"][place],
                "chosen_among": entry.chosen_among,
                "validation_spl": entry.spl,
                "spl": own,
            }
        )

    return found
