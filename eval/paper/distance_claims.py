"""`threshold_claims`, `distance_claims`, `element_claims`: the paper on its Figs. 5 and 6."""

from collections.abc import Sequence
from functools import partial
from math import inf

import numpy as np

from eval.paper.claim import ELEMENTS_AT_DB, Claim, number, statement
from eval.paper.study import (
    CONTINUOUS,
    ONE_BIT,
    SCHEMES,
    THREE_BIT,
    TWO_BIT,
    WITHOUT,
    Scheme,
    Study,
)
from irs_gym import TradeOff
from irs_gym.radio.irs import Quantiser

# --- IV-3: distance over the target ---------------------------------------------------------------

_threshold = partial(number, unit=" dB", digits=3, tolerance=0.05)  # printed to a tenth of a dB


def threshold_claims(study: Study) -> list[Claim]:
    """Highest feasible targets, Fig. 5."""
    without = study.threshold(WITHOUT)
    continuous = study.threshold(CONTINUOUS)

    return [
        _distance_rises(study),
        _infeasible_without_irs(without),
        _feasible_up_to(study, ONE_BIT, -60.9),
        _feasible_up_to(study, TWO_BIT, -60.0),
        _threshold("Continuous phases, feasible up to", -59.5, continuous),
        _threshold("which is a gain over no IRS of", 2.6, continuous - without),
        _four_thresholds(study),
    ]


def _distance_rises(study: Study) -> Claim:
    steps = [study.curve(scheme).distances for scheme in SCHEMES]
    return statement(
        "Fig. 5: the distance generally increases with the target",
        f"{sum(map(len, steps))} steps in {len(steps)} curves, all upwards",
        all(len(each) and np.all(np.diff(each) > 0) for each in steps),
        remark="By construction: a higher target takes cells away.",
    )


def _infeasible_without_irs(without_db: float) -> Claim:
    there = "still feasible" if without_db >= -62.1 else "infeasible"
    return _threshold(
        "Without IRS, infeasible from",
        -62.1,
        without_db,
        remark="Ours is the highest feasible target. The paper prints tenths of a decibel, and to "
        f"a tenth the two are one; at -62.1 dB itself ours is {there}.",
    )


def _feasible_up_to(study: Study, scheme: Scheme, printed_db: float) -> Claim:
    """Not promised: it depends on how eq. (20) is read."""
    letter, wrapped = (study.threshold(scheme, each) for each in ("as_printed", "nearest"))
    where = "between" if letter < printed_db < wrapped else "outside"
    return _threshold(
        f"{scheme.name}, feasible up to",
        printed_db,
        partial(study.threshold, scheme),
        is_promised=False,
        remark=f"The paper's value lies {where} the two readings of its eq. (20): "
        f"{letter:.3f} dB to the letter, {wrapped:.3f} dB with the distance on the circle. "
        "We promise neither.",
    )


def _four_thresholds(study: Study) -> Claim:
    three_bit = study.threshold(THREE_BIT)
    continuous = study.threshold(CONTINUOUS)
    return Claim(
        'The thresholds "for the IRS-aided schemes" are -62.1, -60.9, -60 and -59.5 dB',
        "4 values",
        ("5 schemes",),
        "",
        is_met=False,
        is_promised=False,
        remark="The paper contradicts itself: the first value is the one it gives for no IRS a "
        "sentence before, and its next sentence has the 1-bit scheme feasible up to -60.9 dB. We "
        "read the list as: without IRS, 1 bit, 2 bit, 3 bit with continuous (ours: "
        f"{three_bit:.3f} and {continuous:.3f} dB).",
    )


def distance_claims(study: Study) -> list[Claim]:
    """Ratios of distances, Fig. 5."""
    without = excess(study.curve(WITHOUT), study.curve(CONTINUOUS), -63.5, -62.5)

    return [
        number(
            "Without IRS, for targets from -63.5 to -62.5 dB, up to so much farther",
            18.87,
            without,
            " %",
            digits=2,
            tolerance=0.005,
        ),
        _one_bit_is_farther(study),
        _finer_bits_lose_little(study),
    ]


def _one_bit_is_farther(study: Study) -> Claim:
    def at_most(quantiser: Quantiser, low_db: float = -61.9, high_db: float = -60.9) -> float:
        one_bit = study.curve(ONE_BIT, quantiser)
        finer = [study.curve(scheme, quantiser) for scheme in (TWO_BIT, THREE_BIT, CONTINUOUS)]
        return max(excess(one_bit, each, low_db, high_db) for each in finer)

    one_bit, other = (study.distance(scheme, ELEMENTS_AT_DB) for scheme in (ONE_BIT, CONTINUOUS))
    rounded = 100 * (round(one_bit, 2) / other - 1)
    anywhere = at_most("nearest", -inf, study.threshold(ONE_BIT))
    to_the_letter = study.threshold(ONE_BIT, "as_printed")

    return number(
        "1 bit against finer phases, for targets from -61.9 to -60.9 dB, at most so much farther",
        10.38,
        at_most,
        " %",
        digits=2,
        tolerance=0.02,
        remark=f"At {ELEMENTS_AT_DB:g} dB {one_bit:.3f} m against {other:.3f} m; {one_bit:.2f} m, "
        f"rounded to the centimetre, against {other:.3f} m gives {rounded:.2f} %. Outside that "
        f"range of targets 1 bit costs up to {anywhere:.2f} %. To the letter of eq. (20) it is "
        f"infeasible from {to_the_letter:.2f} dB on, within the range.",
    )


def _finer_bits_lose_little(study: Study) -> Claim:
    continuous = study.curve(CONTINUOUS)
    one, two, three = (
        lost_db(study.curve(scheme), continuous) for scheme in (ONE_BIT, TWO_BIT, THREE_BIT)
    )
    farther = [
        excess(study.curve(scheme), continuous, -inf, study.threshold(scheme))
        for scheme in (TWO_BIT, THREE_BIT)
    ]

    return statement(
        "The degradation by 2 or 3 bits is negligible",
        f"{two:.2f} and {three:.2f} dB of target at most, 1 bit {one:.2f} dB",
        max(two, three) < one / 2,
        remark="Taken as: less than half of what 1 bit loses. In metres it is not negligible "
        f"everywhere: within these fractions of a dB the path is up to {farther[0]:.2f} % and "
        f"{farther[1]:.2f} % longer.",
    )


def excess(longer: TradeOff, shorter: TradeOff, low_db: float, high_db: float) -> float:
    """By how many per cent the one curve lies above the other at most, over all targets of a range,
    exactly.

    +inf where the first alone is infeasible somewhere in the range.
    """
    # Both curves are constant between steps: it is enough to look at each step and right after it.
    steps = np.concatenate([longer.targets_db, shorter.targets_db])
    targets = np.concatenate([[low_db, high_db], steps, np.nextafter(steps, inf)])
    targets = targets[(targets >= low_db) & (targets <= high_db)]
    targets = targets[np.isfinite(shorter.distance_at(targets))]
    ratios = longer.distance_at(targets) / shorter.distance_at(targets)

    return float(100 * np.max(ratios - 1, initial=-inf))


def lost_db(coarse: TradeOff, fine: TradeOff) -> float:
    """How much lower the target must be at most for the coarse scheme to be no longer than the fine
    one, in dB.
    """
    lost = [-inf]

    for target_db, distance in zip(fine.targets_db, fine.distances, strict=True):
        reached = coarse.targets_db[coarse.distances <= distance + 1e-9]
        lost.append(target_db - max(reached, default=-inf))

    return float(max(lost))


# --- IV-4: distance over the number of elements ---------------------------------------------------


ROWS = 18  # of sub-surfaces on a panel, the most whose distances are compared


def element_counts(study: Study, rows: int = ROWS) -> range:
    """Numbers of elements M: whole rows of sub-surfaces."""
    step = study.scene.irs_panels[0].elements_per_row
    return range(step, rows * step + 1, step)


def extra_elements(
    study: Study, coarse: Scheme, finer: Sequence[Scheme], quantiser: Quantiser
) -> float:
    """How many more elements the coarse scheme needs at most for a distance that a finer one has.

    The finer ones have up to `ROWS` rows of sub-surfaces. The coarse one may have twice as many;
    infinite where it needs yet more.
    """
    counts = element_counts(study, 2 * ROWS)

    def fewest(scheme: Scheme, distance: float) -> float:
        lengths = (study.distance(scheme, ELEMENTS_AT_DB, quantiser, m) for m in counts)
        return next(
            (m for m, length in zip(counts, lengths, strict=False) if length <= distance + 1e-9),
            inf,
        )

    extra = [0.0]
    for scheme in finer:
        lengths = {
            study.distance(scheme, ELEMENTS_AT_DB, quantiser, m) for m in element_counts(study)
        }
        reached = lengths - {inf}
        extra += [fewest(coarse, distance) - fewest(scheme, distance) for distance in reached]

    return max(extra)


def element_claims(study: Study) -> list[Claim]:
    """What the paper's Fig. 6 shows."""
    return [_distance_falls(study), _one_bit_needs_more(study), _finer_bits_need_few(study)]


def _distance_falls(study: Study) -> Claim:
    schemes = [scheme for scheme in SCHEMES if scheme.has_irs]
    lengths = np.array(
        [
            [study.distance(scheme, ELEMENTS_AT_DB, elements=m) for m in element_counts(study)]
            for scheme in schemes
        ]
    )  # (schemes, counts)
    never_rises = np.all(lengths[:, 1:] <= lengths[:, :-1] + 1e-9)
    falls_in_all = np.all(lengths[:, 0] > lengths[:, -1])

    return statement(
        f"Fig. 6, {ELEMENTS_AT_DB:g} dB: the distance generally decreases with M",
        f"from {lengths.max():.3f} to {lengths.min():.3f} m, never up",
        never_rises and falls_in_all,
    )


def _one_bit_needs_more(study: Study) -> Claim:
    finer = (TWO_BIT, THREE_BIT, CONTINUOUS)
    step = element_counts(study).step
    return number(
        "1 bit needs at most so many more elements for the same distance",
        600,
        lambda quantiser: extra_elements(study, ONE_BIT, finer, quantiser),
        "",
        digits=0,
        tolerance=0,
        remark=f"A row of sub-surfaces is {step} elements, so M moves in steps of {step}; the text "
        "gives no range for the axis, and no other step would be a whole row of the N_x = 10 "
        "columns it fixes.",
    )


def _finer_bits_need_few(study: Study) -> Claim:
    two, three = (
        extra_elements(study, scheme, [CONTINUOUS], "nearest") for scheme in (TWO_BIT, THREE_BIT)
    )
    return statement(
        "2 and 3 bits are close to continuous phases",
        f"{two:.0f} and {three:.0f} more elements at most",
        max(two, three) <= element_counts(study).step,
        remark="Taken as: at most one row of sub-surfaces.",
    )
