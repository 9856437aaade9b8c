"""`SceneScores`: the SPL of every seed in every scene, in one file, and all figures that follow.

To make an interval anew, NumPy is enough, and `eval.statistics`::

    file = numpy.load("docs/generalisation.npz")
    spl = file["spl/explorer, untrained/ood-maze"] / 65535  # (seeds, scenes)
    eval.statistics.crossed_mean(spl)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.estimates import estimate_as_json
from eval.statistics import (
    SCORE,
    Bounds,
    crossed_mean,
    estimate,
    mean_of_crossed,
    success_rate,
)
from eval.unseen.page_sets import SetFacts, Track
from irs_gym.datasets.splits import FAMILIES
from irs_gym.files import read_arrays, write_file

RIVALS = {"untrained_explorer": "over_untrained", "replanning": "over_replanning"}
IN_THESE = "_in_these_scenes"  # behind the name of a difference: its interval is over seeds alone
MEAN = "families"  # over all of them, in place of a set's name
FAMILY_SETS = tuple(f"ood-{name}" for name in FAMILIES)
TOP = 65535  # of an SPL in the file: a path as short as the oracle's
_BYTES = 2**27  # of the file
_DIFFERENCE: Bounds = (-1.0, 1.0)
_EXACT = 1e-6  # of an SPL; the next longer path in reach is 1e-5 longer or more

Spl = NDArray[np.uint16]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SceneScores:
    """What every policy of a page did in every scene.

    Attributes
    ----------
    spl
        By `key_of` and the name of a set, ``"KEY/SET"``: uint16, shape ``(seeds, scenes)``, in
        shares of `TOP`; 0 for a failure alone, `TOP` where the path is as short as the oracle's
        alone.
    is_hard
        By track and set, ``"TRACK/SET"``: shape ``(scenes,)``.
    """

    spl: Mapping[str, Spl]
    is_hard: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def of(
        cls,
        tables: Mapping[str, Mapping[str, Floats]],
        facts: Mapping[Track, Mapping[str, SetFacts]],
    ) -> "SceneScores":
        """From SPL by `key_of` and set."""
        return cls(
            {
                f"{key}/{name}": packed(table)
                for key, by_set in tables.items()
                for name, table in by_set.items()
            },
            {
                f"{track}/{name}": each.is_hard
                for track, by_name in facts.items()
                for name, each in by_name.items()
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
            elif kind == "spl" and array.ndim == 2 and array.dtype == np.uint16:
                spl[key] = array
            else:
                raise ValueError(
                    f"{name} in {str(path)!r} must be spl/..., uint16 (seeds, scenes), "
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

    def of_entrants(self, entrants: Sequence[Mapping[str, Any]]) -> dict[str, Spl]:
        """The part of `spl` that is of some entrants of a page."""
        starts = tuple(f"{key_of(each)}/" for each in entrants)
        return {key: each for key, each in self.spl.items() if key.startswith(starts)}

    def results(
        self, entrant: Mapping[str, Any], entrants: Sequence[Mapping[str, Any]]
    ) -> dict[str, Any]:
        """Of one entrant of a page, by set: success, SPL and the ratio over successes, on all
        scenes and on the hard ones; in the local track also the differences from `RIVALS`.

        `MEAN` is over all families, where it has played all.

        Raises
        ------
        ValueError
            Where the scores of a set that it has played are missing.
        """
        names = self._sets(entrant)
        rivals = self._rivals(entrant, entrants)
        found = {}

        for name in names:
            spl = self._spl(entrant, name)  # (seeds, scenes)
            is_hard = self.is_hard.get(f"{entrant['track']}/{name}")
            if is_hard is None or is_hard.shape != spl.shape[1:]:
                raise ValueError(f"which of the scenes of {name!r} are hard is missing")

            theirs = {over: self._spl(each, name) for over, each in rivals.items()}
            found[name] = results_of(spl, is_hard, theirs)

        if {*FAMILY_SETS} <= {*names}:
            found[MEAN] = {"all": self._over_families(entrant, rivals)}

        return found

    def own(self, entrant: Mapping[str, Any], place: int) -> dict[str, Any]:
        """SPL of one of its seeds by set, with its interval over scenes."""
        found = {
            name: estimate_as_json(crossed_mean(self._spl(entrant, name)[place], SCORE))
            for name in self._sets(entrant)
        }
        if {*FAMILY_SETS} <= {*found}:
            whole = self._mean_table(entrant)[place]  # (scenes,)
            found[MEAN] = estimate_as_json(crossed_mean(whole, SCORE))

        return found

    def left_out(
        self, by_family: Mapping[str, Mapping[str, Any]], entrants: Sequence[Mapping[str, Any]]
    ) -> dict[str, Any]:
        """Of entrants by the family that each has not learned on: the mean over these families of
        SPL and differences, over other seeds and scenes of these families, and over other families.
        """
        rivals = self._rivals(next(iter(by_family.values())), entrants)
        tables = {
            name: self._spl(each, f"ood-{name}") for name, each in by_family.items()
        }  # of (seeds, scenes)
        found = {"spl": _two_means(list(tables.values()), SCORE)}

        for over, rival in rivals.items():
            less = [table - self._spl(rival, f"ood-{name}") for name, table in tables.items()]
            found[over] = _two_means(less, _DIFFERENCE)

        return found

    def _over_families(
        self, entrant: Mapping[str, Any], rivals: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, Any]:
        """Mean over families, for other seeds and other scenes of these families."""
        table = self._mean_table(entrant)
        won = self._mean_table(entrant, successes=True)
        return {
            "spl": estimate_as_json(crossed_mean(table, SCORE)),
            "success": estimate_as_json(success_rate(won)),
            **_differences(
                table, {over: self._mean_table(rival) for over, rival in rivals.items()}
            ),
        }

    def _mean_table(self, entrant: Mapping[str, Any], *, successes: bool = False) -> Floats:
        """SPL ``(seeds, scenes)`` over families: scene n is the mean of the n-th of each, which is
        a draw as they are.
        """
        tables = [self._spl(entrant, name) for name in FAMILY_SETS]
        fewest = min(table.shape[1] for table in tables)
        each = np.stack([table[:, :fewest] for table in tables])

        return np.asarray((each > 0 if successes else each).mean(axis=0))

    def _rivals(
        self, entrant: Mapping[str, Any], entrants: Sequence[Mapping[str, Any]]
    ) -> dict[str, Mapping[str, Any]]:
        """Whom an entrant is compared with, by the name of the difference."""
        others = {each["algorithm"]: each for each in entrants}
        return {
            over: others[algorithm]
            for algorithm, over in RIVALS.items()
            if algorithm in others
            and algorithm != entrant["algorithm"]
            and entrant["track"] == "local"
        }

    def _sets(self, entrant: Mapping[str, Any]) -> list[str]:
        start = f"{key_of(entrant)}/"
        found = [key.removeprefix(start) for key in self.spl if key.startswith(start)]
        if not found:
            raise ValueError(f"the scores of {key_of(entrant)!r} are missing")

        return found

    def _spl(self, entrant: Mapping[str, Any], name: str) -> Floats:
        table = self.spl.get(f"{key_of(entrant)}/{name}")
        if table is None or len(table) != max(1, len(entrant["seeds"])):
            raise ValueError(f"the scores of {key_of(entrant)!r} on {name!r} are missing")

        return table / TOP


def packed(spl: Floats) -> Spl:
    """SPL as `SceneScores` keeps it."""
    levels = np.clip(np.rint(spl * TOP), 1, TOP - 1)
    levels[spl <= 0.0] = 0
    levels[spl >= 1.0 - _EXACT] = TOP

    return levels.astype(np.uint16)


def key_of(entrant: Mapping[str, Any]) -> str:
    """Names an entrant of a page: no two have both name and training scenes in common."""
    scenes = entrant["training_scenes"]
    return entrant["name"] if scenes is None else f"{entrant['name']}, {scenes} scenes"


def results_of(
    spl: Floats, is_hard: NDArray[np.bool_], rivals: Mapping[str, Floats]
) -> dict[str, Any]:
    """Figures of SPL ``(seeds, scenes)``, with intervals over seeds and scenes; of differences,
    over seeds alone as well.
    """
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
            "exact": float((part >= 1.0 - _EXACT).mean()),
            "ratio": float(np.mean(ratios)) if ratios else None,
            **_differences(part, {name: theirs[:, chosen] for name, theirs in rivals.items()}),
        }

    return found


def _differences(spl: Floats, rivals: Mapping[str, Floats]) -> dict[str, Any]:
    """Mean differences of SPL ``(seeds, scenes)`` by the name of each: over other seeds and scenes
    and, where there are seeds, over other seeds in these very scenes.
    """
    found = {}

    for name, theirs in rivals.items():
        less = spl - theirs  # (seeds, scenes)
        found[name] = estimate_as_json(crossed_mean(less, _DIFFERENCE))
        if len(less) > 1:
            found[name + IN_THESE] = estimate_as_json(estimate(less, within=_DIFFERENCE))

    return found


def _two_means(tables: Sequence[Floats], within: Bounds) -> dict[str, Any]:
    """Mean over families of tables ``(seeds, scenes)``: over other seeds and scenes of these, and
    over other families, of which these are draws.
    """
    return {
        "these": estimate_as_json(mean_of_crossed(tables, within)),
        "others": estimate_as_json(estimate([table.mean() for table in tables], within=within)),
    }


def means_over_seeds(entrant: Mapping[str, Any]) -> dict[str, Any]:
    """By set, on all scenes and on the hard ones: success and SPL of an entrant whose scores in the
    scenes are lost, from the means of its seeds; the intervals hold over seeds, in these very
    scenes.
    """
    return {
        name: {
            label: {
                **each,
                "success": estimate_as_json(estimate(each["success_by_seed"], within=SCORE)),
                "spl": estimate_as_json(estimate(each["spl_by_seed"], within=SCORE)),
            }
            for label, each in by_label.items()
        }
        for name, by_label in entrant["sets"].items()
    }
