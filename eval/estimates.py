"""`estimate_as_json`, `estimate_cell`: an estimate as a record, and such a record in a table."""

from collections.abc import Callable, Mapping
from math import isinf
from typing import Any

from eval.statistics import ALL_EQUAL, FEW_SEEDS, Estimate


def finite(value: float) -> float | None:
    """The number, or None for infinity, which JSON does not have."""
    return None if isinf(value) else value


def estimate_as_json(found: Estimate) -> dict[str, Any]:
    """An estimate for JSON; ``"interval"`` is null where there is none, and null stands for
    infinity elsewhere.
    """
    interval = (
        None if found.low is None or found.high is None else [finite(found.low), finite(found.high)]
    )
    return {"value": finite(found.value), "interval": interval, "note": found.note}


def estimate_cell(found: Mapping[str, Any] | None, shown: Callable[[Any], str]) -> str:
    """The figure of such a record as `shown` writes it, and its interval below, or a mark where
    all seeds are equal, or too few for 95 %.
    """
    if found is None:
        return "–"
    if found["note"] == ALL_EQUAL:
        return f"{shown(found['value'])} †"

    mark = " ‡" if found["note"] == FEW_SEEDS else ""
    return f"{shown(found['value'])}{mark}{interval_below(found, shown)}"


def interval_below(found: Mapping[str, Any], shown: Callable[[Any], str]) -> str:
    """The interval of such a record in small print on a line of its own; nothing where there is
    none.
    """
    if found["interval"] is None:
        return ""

    low, high = map(shown, found["interval"])
    return f"<br><sub>{low} to {high}</sub>"
