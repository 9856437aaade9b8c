"""`SceneScores`: the SPL of every seed in every scene, in one file, and all figures that follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.estimates import estimate_as_json
from eval.statistics import SCORE, Bounds, crossed_mean, estimate, success_rate
from eval.unseen.policy_results import Track
from eval.unseen.scores import HARD, detours
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.files import read_arrays, write_file

RIVALS = {"replanning": "over_replanning", "untrained_explorer": "over_untrained"}
BOTH = "seeds and scenes"  # what intervals are over
SEEDS = "seeds"
_BYTES = 2**27  # of the file
_DIFFERENCE: Bounds = (-1.0, 1.0)
_EXACT = 1e-6  # of an SPL as float32; the next longer path in reach is 1e-5 longer or more

Spl = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SceneScores:
    """What every policy of a page did in every scene.

    Attributes
    ----------
    spl
        By `key_of` and the name of a set, ``"KEY/SET"``: float32, shape ``(seeds, scenes)``; 0 for
        a failure alone.
    is_hard
        By track and set, ``"TRACK/SET"``: shape ``(scenes,)``.
    """

    spl: Mapping[str, Spl]
    is_hard: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def of(
        cls,
        tables: Mapping[str, Mapping[str, NDArray[np.float64]]],
        pools: Mapping[Track, Mapping[str, SceneSet]],
    ) -> "SceneScores":
        """From SPL by `key_of` and set."""
        return cls(
            {
                f"{key}/{name}": table.astype(np.float32)
                for key, by_set in tables.items()
                for name, table in by_set.items()
            },
            {
                f"{track}/{name}": detours(pool) > HARD
                for track, by_name in pools.items()
                for name, pool in by_name.items()
            },
        )

    @classmethod
    def read(cls, path: Path) -> "SceneScores":
        """From its file.

        Raises
        ------
        OSError
            Where the file cannot be read.
        ValueError
            Where it is damaged.
        """
        spl: dict[str, Spl] = {}
        is_hard: dict[str, NDArray[np.bool_]] = {}

        for name, array in read_arrays(path, limit=_BYTES).items():
            kind, _, key = name.partition("/")
            if kind == "hard" and array.ndim == 1 and array.dtype == np.bool_:
                is_hard[key] = array
            elif kind == "spl" and array.ndim == 2 and array.dtype == np.float32:
                if not ((array >= 0) & (array <= 1)).all():
                    raise ValueError(f"{name} in {str(path)!r} has an SPL outside of 0 to 1")
                spl[key] = array
            else:
                raise ValueError(
                    f"{name} in {str(path)!r} must be spl/..., float32 (seeds, scenes), "
                    "or hard/..., bool (scenes,)"
                )

        return cls(spl, is_hard)

    def write(self, path: Path) -> None:
        """Into a file of plain arrays."""
        arrays: dict[str, Any] = {f"spl/{key}": each for key, each in self.spl.items()}
        arrays |= {f"hard/{key}": each for key, each in self.is_hard.items()}
        content = BytesIO()
        np.savez_compressed(content, **arrays)
        write_file(path, content.getvalue())

    def results(
        self, entrant: Mapping[str, Any], entrants: Sequence[Mapping[str, Any]]
    ) -> dict[str, Any]:
        """Of one entrant of a page, by set: success, SPL and the ratio over successes, on all
        scenes and on the hard ones; in the local track also the differences from `RIVALS`.

        Raises
        ------
        ValueError
            Where the scores of a set that it has played are missing.
        """
        found = {}

        for name in self._sets(entrant):
            spl = self._spl(entrant, name)  # (seeds, scenes)
            is_hard = self.is_hard.get(f"{entrant['track']}/{name}")
            if is_hard is None or is_hard.shape != spl.shape[1:]:
                raise ValueError(f"which of the scenes of {name!r} are hard is missing")

            rivals = {
                RIVALS[each["algorithm"]]: self._spl(each, name)
                for each in entrants
                if each["algorithm"] in RIVALS
                and each["algorithm"] != entrant["algorithm"]
                and entrant["track"] == "local"
            }
            found[name] = results_of(spl, is_hard, rivals)

        return found

    def own(self, entrant: Mapping[str, Any], place: int) -> dict[str, Any]:
        """SPL of one of its seeds by set, with its interval over scenes."""
        return {
            name: estimate_as_json(crossed_mean(self._spl(entrant, name)[place], SCORE))
            for name in self._sets(entrant)
        }

    def _sets(self, entrant: Mapping[str, Any]) -> list[str]:
        start = f"{key_of(entrant)}/"
        found = [key.removeprefix(start) for key in self.spl if key.startswith(start)]
        if not found:
            raise ValueError(f"the scores of {key_of(entrant)!r} are missing")

        return found

    def _spl(self, entrant: Mapping[str, Any], name: str) -> NDArray[np.float64]:
        table = self.spl.get(f"{key_of(entrant)}/{name}")
        if table is None or len(table) != max(1, len(entrant["seeds"])):
            raise ValueError(f"the scores of {key_of(entrant)!r} on {name!r} are missing")

        return table.astype(np.float64)


def key_of(entrant: Mapping[str, Any]) -> str:
    """Names an entrant of a page: no two have both name and training scenes in common."""
    scenes = entrant["training_scenes"]
    return entrant["name"] if scenes is None else f"{entrant['name']}, {scenes} scenes"


def results_of(
    spl: NDArray[np.float64],
    is_hard: NDArray[np.bool_],
    rivals: Mapping[str, NDArray[np.float64]],
) -> dict[str, Any]:
    """Figures of SPL ``(seeds, scenes)``, with intervals over seeds and scenes."""
    found = {}

    for label, chosen in (("all", np.ones_like(is_hard)), ("hard", is_hard)):
        if not chosen.any():
            continue

        part = spl[:, chosen]  # (seeds, chosen)
        won = part > 0

        # the ratio says nothing of failures; a seed without a success has none
        solved = [row[each] for row, each in zip(part, won, strict=True) if each.any()]
        ratios = [float((1.0 / each).mean()) for each in solved]
        found[label] = {
            "success": estimate_as_json(success_rate(won)),
            "spl": estimate_as_json(crossed_mean(part, SCORE)),
            "spl_by_seed": part.mean(axis=1).tolist(),
            "success_by_seed": won.mean(axis=1).tolist(),
            "exact": float((part >= 1.0 - _EXACT).mean()),
            "ratio": float(np.mean(ratios)) if ratios else None,
            **{
                name: estimate_as_json(crossed_mean(part - theirs[:, chosen], _DIFFERENCE))
                for name, theirs in rivals.items()
            },
        }

    return found


def results_over_seeds(
    entrant: Mapping[str, Any], entrants: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """The same of an entrant whose scores in the scenes are lost, from the means of its seeds: the
    intervals hold over seeds, in these very scenes.

    The difference from replanning keeps the interval that it has.
    """
    found: dict[str, Any] = {}
    untrained = next((each for each in entrants if each["algorithm"] == "untrained_explorer"), None)

    for name, by_label in entrant["sets"].items():
        found[name] = {}

        for label, each in by_label.items():
            means = each["spl_by_seed"]
            anew = {
                "success": estimate_as_json(estimate(each["success_by_seed"], within=SCORE)),
                "spl": estimate_as_json(estimate(means, within=SCORE)),
            }
            if untrained is not None and entrant["track"] == "local" and entrant is not untrained:
                theirs = untrained["sets"][name][label]["spl"]["value"]
                less = np.array(means) - theirs
                anew["over_untrained"] = estimate_as_json(estimate(less, within=_DIFFERENCE))

            found[name][label] = {**each, **anew}

    return found
