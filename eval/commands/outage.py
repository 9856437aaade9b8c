"""`python -m eval outage`: the outage in closed form beside channels drawn element by element."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eval.markdown import picture, table, template
from eval.paper.outage_draws import OutageDraws, draw_cells, draw_panels
from eval.paper.outage_figures import draw_errors, draw_outages
from irs_gym.files import write_file


def main(out: Path = Path("docs"), draws: int = 40_000, seed: int = 0) -> int:
    """Draw channels in cells of each kind and over panels of any size, and write a page with the
    errors of the closed form.

    Writes OUT/fading.md and OUT/figures/outage and outage_error, each as .png, .svg and .csv. Takes
    about two minutes.

    Parameters
    ----------
    out
        Folder of the page.
    draws
        Channels for each cell and panel, rounded up to whole batches.
    seed
        Seed of the draws.
    """
    if draws < 1:
        print(f"python -m eval outage: draws={draws} must be positive", file=sys.stderr)
        return 2

    try:
        cells = draw_cells(draws, seed)
        panels = draw_panels(draws, seed)
        draw_outages(cells, out / "figures")
        draw_errors(panels, out / "figures")
        write_file(out / "fading.md", fading_page(cells, panels).encode())
    except OSError as error:
        print(f"python -m eval outage: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / 'fading.md'}, and {out / 'figures'}")
    return 0


def fading_page(cells: Sequence[OutageDraws], panels: Mapping[str, Sequence[OutageDraws]]) -> str:
    """The page: the formula, and how far drawn channels are from it."""
    return template("fading.md").format(
        draws=len(cells[0].gains),
        sampling_error=cells[0].sampling_error,
        cells=_cells_table(cells),
        cells_picture=picture(
            "outage",
            "Outage over the threshold; lines: closed form, marks: drawn, with 2 standard errors.",
        ),
        panels=_panels_table(panels),
        panels_picture=picture(
            "outage_error", "Worst error of the closed form over the number of elements."
        ),
        conclusion=_conclusion(panels),
    )


def _cells_table(cells: Sequence[OutageDraws]) -> str:
    header = (
        "cell",
        "phases",
        "M",
        "mean gain (dB)",
        "A² / tau (dB)",
        "outage 10 dB below the mean",
        "drawn",
        "worst error",
    )
    rows = []

    for each in cells:
        has_los = each.fading.los_gain > 0
        threshold_db = np.array([each.mean_gain_db - 10.0])
        rows.append(
            (
                each.place,
                each.phases,
                each.elements,
                f"{each.mean_gain_db:.2f}",
                f"{each.los_over_scatter_db:.1f}" if has_los else "no line of sight",
                f"{each.exact(threshold_db)[0]:.5f}",
                f"{each.drawn(threshold_db)[0]:.5f}",
                f"{each.worst_error:.4f}",
            )
        )

    return table(header, rows)


def _panels_table(panels: Mapping[str, Sequence[OutageDraws]]) -> str:
    """Worst errors, a row for each M."""
    sizes = [each.elements for each in next(iter(panels.values()))]
    drawn = next(iter(panels.values()))
    rows = [
        (
            size,
            *(f"{case[n].worst_error:.4f}" for case in panels.values()),
            f"{drawn[n].sampling_error:.4f}",
            f"{len(drawn[n].gains):,}",
        )
        for n, size in enumerate(sizes)
    ]

    return table(("M", *panels, "sampling alone", "draws"), rows)


def _conclusion(panels: Mapping[str, Sequence[OutageDraws]]) -> str:
    """From which M on each case is as right as draws can tell."""
    words = []

    for case, sizes in panels.items():
        off = [n for n, each in enumerate(sizes) if each.worst_error > each.sampling_error]
        first = off[-1] + 1 if off else 0  # after the last that is off
        holds = "for none of these M"
        if first < len(sizes):
            holds = f"from M = {sizes[first].elements} on"

        worst = f"{sizes[0].worst_error:.3f} at M = {sizes[0].elements}"
        words.append(f"- {case}: {holds}; the worst error is {worst}")

    return "\n".join(words)
