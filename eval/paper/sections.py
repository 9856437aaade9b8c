"""Sections of docs/paper.md on the paper itself: its claims, its formulas, what it leaves open."""

from collections.abc import Sequence
from math import isfinite

from eval.markdown import page, picture, table
from eval.paper.claim import ELEMENTS_AT_DB, PATHS_AT_DB, Claim
from eval.paper.distance_claims import ROWS, element_counts, extra_elements
from eval.paper.monte_carlo import Evidence
from eval.paper.study import CONTINUOUS, ONE_BIT, Study


def claims_section(claims: Sequence[Claim]) -> str:
    """The table of claims and its notes."""
    rows = []
    notes: list[str] = []

    for claim in claims:
        if claim.remark:
            notes.append(f"{len(notes) + 1}. {claim.remark}")

        mark = f" ({len(notes)})" if claim.remark else ""
        ours = claim.ours if len(claim.ours) > 1 else (*claim.ours, "", "")  # a column a quantiser
        rows.append((claim.text + mark, claim.printed, *ours, claim.difference, claim.verdict))

    header = (
        "the paper says",
        "printed",
        "ours, nearest",
        "as printed",
        "optimal",
        "difference",
        "verdict",
    )

    return page("## Claims", table(header, rows), "\n".join(notes))


FIGURES = (
    "## Figures",
    picture(
        "scene",
        "The scene (the paper's Fig. 2). The bar through the IRS is the panel at its true size.",
    ),
    picture(
        "gain_maps", "Expected channel gain without and with IRS (Fig. 3). Obstacles are hatched."
    ),
    picture(
        "paths",
        f"Shortest paths at {PATHS_AT_DB:g} dB (Fig. 4). Where two coincide, both lines show.",
    ),
    picture(
        "distance_over_target", "Shortest distance over the target (Fig. 5): exact steps, no sweep."
    ),
    picture(
        "distance_over_elements",
        f"Shortest distance over the elements at {ELEMENTS_AT_DB:g} dB (Fig. 6).",
    ),
)


def corrections_section(
    evidence: Sequence[Evidence], lost: dict[int, tuple[float, float, float]]
) -> str:
    """What the formulas have to be, by draws of the channels."""
    formulas = (
        "Lemma 1, second term: eta_AM (Appendix A), printed eta_IM",
        "tau: M elements (Appendix A), printed N sub-surfaces",
        "eq. (20): distance on the circle, printed abs(theta - theta*) on [0, 2 pi)",
        "Lemma 1 over two panels: line-of-sight parts add coherently; the rival adds their powers",
    )
    rows = [
        (
            name,
            each.subject,
            f"{each.means[-1] / each.ours:.4f} ± {each.errors[-1] / each.ours:.4f}",
            f"{each.deviations[0]:+.1f}",
            f"{each.rival / each.ours:.4g}",
            f"{each.deviations[1]:+.0f}",
            f"{each.effect_db:.3f}",
        )
        for name, each in zip(formulas, evidence, strict=True)
    ]
    header = (
        "formula",
        "drawn",
        "mean / ours",
        "z",
        "rival / ours",
        "z",
        "largest effect on the map (dB)",
    )
    losses = [
        (f"{bits} bit", f"{mean:.4f} ± {error:.4f}", f"{exact:.4f}")
        for bits, (mean, error, exact) in lost.items()
    ]

    return page(
        "## Corrections, by drawn channels",
        "Rician channels of every element are drawn one by one, in the cell where the two "
        f"formulas differ most, and put into eq. (4), {evidence[0].draws[-1]:,} times. The mean "
        "of the draws stands over our closed form, with its standard error; z counts the standard "
        "errors from either formula to the mean. The rival is the paper's formula as printed.",
        table(header, rows),
        picture("monte_carlo", "The first three, as the draws go on."),
        "What the missing wrap of eq. (20) costs the reflected amplitude, over uniformly random "
        "phases:",
        table(("phases", "drawn (dB)", "exactly (dB)"), losses),
        "Corrected besides, without an effect on a number: g and r have M entries, not N, since "
        "Theta is M x M; the line-of-sight parts are h-bar and r-bar (the text lists h-hat); the "
        "objective of (15) sums over d, not n; L of eqs. (18) and (19) is a loss in dB, so the "
        "channels scale with 10^(-L/10).",
    )


def open_choices_section(study: Study) -> str:
    """How the printed numbers depend on what the paper leaves open."""
    chosen = study.scene.irs_panels[0]
    variants = [
        (shape, chosen.pitch_wavelengths)
        for shape in ((1, 20), (2, 10), (4, 5), (5, 4), (10, 2), (20, 1))
    ]
    variants += [(chosen.elements_per_subsurface, pitch) for pitch in (0.05, 0.2, 0.25, 0.5)]
    rows = []

    for shape, pitch in variants:
        panel = chosen.model_copy(
            update={"elements_per_subsurface": shape, "pitch_wavelengths": pitch}
        )
        other = Study(study.scene.model_copy(update={"irs_panels": (panel,)}), study.cell_size)
        extra = extra_elements(other, ONE_BIT, [CONTINUOUS], "nearest")
        is_chosen = panel == chosen
        row = (
            f"{shape[0]} x {shape[1]}",
            f"{pitch:g}",
            f"{other.threshold(CONTINUOUS):.2f}",
            f"{other.threshold(ONE_BIT):.2f}",
            f"{extra:.0f}"
            if isfinite(extra)
            else f"not by M = {element_counts(other, 2 * ROWS)[-1]:,}",
        )
        rows.append(tuple(f"**{cell}**" for cell in row) if is_chosen else row)

    header = (
        "sub-surface",
        "pitch (wavelengths)",
        "continuous up to (dB)",
        "1 bit up to (dB)",
        "more elements",
    )

    return page(
        "## What the paper leaves open",
        "The pitch of the elements and the shape of a sub-surface are not in the paper. They are "
        "free parameters here, fields of the scene file, and chosen because they meet the printed "
        "numbers: -59.5 dB, and 600 more elements with 1 bit for a distance that continuous "
        f"phases have, with up to {element_counts(study)[-1]:,} of them. Sub-surfaces are "
        "elements along x by elements along z; the choice is in bold.",
        table(header, rows),
        "Also settled so: cells of 0.5 m with the start in the row y = 0.25 m, moves that may cut "
        "corners, line of sight against open boxes in three dimensions, Rician factor 0 on "
        "blocked links, and plane waves over the panel.",
    )
