"""`Claim`: a statement of the paper beside what this package computes."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

import numpy as np

from eval.paper.study import QUANTISERS
from irs_gym.radio.irs import Quantiser

PATHS_AT_DB = -63.0  # target of the paper's Fig. 4
ELEMENTS_AT_DB = -61.8  # target of its Fig. 6


@dataclass(frozen=True)
class Claim:
    """One statement of the paper.

    Attributes
    ----------
    text
        What it says.
    printed
        Its number, or "" where it is in words.
    ours
        Our values with the phases rounded as in `QUANTISERS`; a single one where the rounding has
        no part in it.
    difference
        Ours, with the nearest level, minus the printed one.
    is_met
        Whether ours agrees with the paper, to the precision printed.
    is_promised
        Whether we say that it does.
    remark
        What a reader has to know besides.
    """

    text: str
    printed: str
    ours: tuple[str, ...]
    difference: str
    is_met: bool
    is_promised: bool
    remark: str = ""

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.is_promised:
            return "met" if self.is_met else "NOT MET"
        return "agrees, not promised" if self.is_met else "not met, see note"


def number(
    text: str,
    printed: float,
    ours: Callable[[Quantiser], float] | float,
    unit: str,
    digits: int,
    tolerance: float,
    is_promised: bool = True,
    remark: str = "",
) -> Claim:
    """Claim of a number that is met within a tolerance; ours is given to so many digits."""
    values = [ours(quantiser) for quantiser in QUANTISERS] if callable(ours) else [ours]
    difference = values[0] - printed  # of the nearest level, which is what the paper means

    return Claim(
        text=text,
        printed=f"{printed:g}{unit}",
        ours=tuple(
            f"{value:.{digits}f}{unit}" if isfinite(value) else "infeasible" for value in values
        ),
        difference=f"{difference:+.{digits}f}" if isfinite(difference) else "",
        is_met=abs(difference) <= tolerance,
        is_promised=is_promised,
        remark=remark,
    )


def statement(
    text: str, ours: str, is_met: bool | np.bool_, *, is_promised: bool = True, remark: str = ""
) -> Claim:
    """Claim in words, in which the rounding of the phases has no part."""
    return Claim(text, "", (ours,), "", bool(is_met), is_promised, remark)
