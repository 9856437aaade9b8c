"""`python -m eval codebook`: writes docs/codebook.md, what a panel that holds a few configurations
can do, and what was learned where the robot switches them.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.progress import track
from tyro.conf import Positional, arg

from eval.markdown import page, picture, table, template
from eval.origin import commands_of
from eval.paper.codebook_figures import (
    draw_configurations,
    draw_costs,
    draw_sizes,
    draw_switch_paths,
)
from eval.paper.codebooks import DESIGNS, CodebookStudy, Row, turning_points
from eval.paper.study import CONTINUOUS, ONE_BIT, THREE_BIT, TWO_BIT, Study
from eval.scoreboard.codebook_board import CodebookBoard, codebook_section
from eval.scoreboard.results import LeftOut, Result
from eval.scoreboard.runs_page import Made, results_below, told
from irs_gym import load_scene
from irs_gym.files import write_file

TARGETS_DB = (-62.0, -61.8, -61.2, -60.6, -60.0, -59.6)
SIZES = (1, 2, 4, 8, 16, 32, 64)
SIZES_AT_DB = (-62.0, -61.8, -60.0)
PATHS_AT_DB = -61.8  # its front has a point for each number of switches
MAPS_AT_DB = -60.0
MOST_SWITCHES = 3  # columns of the table
MOST_COST = 5.0  # metres
LEARNED = template("codebook_board.md").partition("\n")[0]  # the heading of that section
TIE = 1e-9  # metres: lengths are sums of floats


def main(
    folder: Annotated[Positional[Path | None], arg(metavar="DIR", help_behavior_hint="")] = None,
    out: Path = Path("docs"),
    cell_size: float = 0.5,
    trained_by: str | None = None,
    keep_tables: bool = False,
) -> int:
    """Compute how few configurations make the shortest path, and write codebook.md with its
    figures and codebook.json, which keeps what was learned.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth, to be added to those of codebook.json; one that
        repeats a seed takes its place.
    out
        Folder of the page.
    cell_size
        Edge of a cell in metres; not of the runs.
    trained_by
        The command that trained the runs, to stand on the page.
    keep_tables
        Leave the page's figures and tables as they are, and write what was learned alone.
    """

    def make() -> Made:
        place = out / "codebook.md"
        kept = CodebookBoard.load(out / "codebook.json")
        results: list[Result] = []
        left_out: list[LeftOut] = []
        if folder is not None:
            results, left_out = results_below(folder)

        if keep_tables:
            computed = place.read_text(encoding="utf-8").partition(f"\n{LEARNED}\n")[0]
        else:
            scene = load_scene("paper").model_copy(update={"phase_bits": None})
            computed = codebook_page(CodebookStudy(Study(scene, cell_size)), out / "figures")

        board = kept.extended(results, left_out)
        if folder is not None:
            made_by = (*kept.commands, *commands_of("codebook", trained_by))
            board = replace(board, commands=tuple(dict.fromkeys(made_by)))

        write_file(out / "codebook.json", board.as_json())
        write_file(place, page(computed, codebook_section(board)).encode())

        return board.runs, left_out, f"{place} and {out / 'figures'}"

    return told("codebook", make)


def codebook_page(codebooks: CodebookStudy, figures: Path) -> str:
    """All of the page that is computed; its figures are written into a folder."""
    study = codebooks.study
    schemes = (CONTINUOUS, ONE_BIT, TWO_BIT, THREE_BIT)
    wanted = [(scheme, target_db) for scheme in schemes for target_db in TARGETS_DB]
    rows = [codebooks.row(*each) for each in track(wanted, "fronts", transient=True)]
    at = {row.target_db: row for row in rows if row.scheme is CONTINUOUS}

    draw_switch_paths(codebooks, at[PATHS_AT_DB], figures)
    draw_configurations(codebooks, at[MAPS_AT_DB], figures)
    draw_costs(list(at.values()), MOST_COST, figures)
    metres = {
        (target_db, design): [codebooks.metres(design, size, target_db) for size in SIZES]
        for target_db in track(SIZES_AT_DB, "sizes", transient=True)
        for design in DESIGNS
    }
    draw_sizes(metres, {each: at[each].following for each in SIZES_AT_DB}, SIZES, figures)

    return page(
        template("codebook.md").format(
            scene=study.scene.name,
            cell_size=study.cell_size,
            cells=len(codebooks.cells),
            table=fronts_table(rows),
            finding=finding(rows),
            paths=picture(
                "codebook_paths",
                f"The shortest paths at {PATHS_AT_DB:g} dB, in a colour a configuration; the panel "
                "switches at the rings.",
            ),
            maps=picture(
                "codebook_maps",
                f"The configurations of the best path at {MAPS_AT_DB:g} dB, each with the cell "
                "that it is focused on (the star), its gains, the border of what meets the target, "
                "and its part of the path.",
            ),
            size_figure=picture(
                "codebook_sizes",
                "Shortest path over the number of configurations; the grey line is where the "
                "phases follow the robot. A codebook that is not drawn has no path.",
            ),
            sizes=sizes_table(metres),
            cost_figure=picture(
                "codebook_costs", "Least metres and switches over the cost of a switch."
            ),
            costs=costs_table(list(at.values())),
        )
    )


def fronts_table(rows: Sequence[Row]) -> str:
    """Metres over the number of switches, a row for each resolution and target."""
    counts = range(MOST_SWITCHES + 1)
    header = (
        "phases",
        "target (dB)",
        "phases follow the robot",
        *(f"{n} switch{'es' * (n != 1)}" for n in counts),
        "any number",
    )
    cells = [
        (
            row.scheme.name,
            f"{row.target_db:g}",
            _metres(row.following),
            *(_metres(row.metres(n)) for n in counts),
            "none"
            if row.front is None
            else f"{row.front.distances[-1]:.3f} with {row.front.switches[-1]}",
        )
        for row in rows
    ]

    return table(header, cells)


def finding(rows: Sequence[Row]) -> str:
    """In how many rows the shortest path needs how few switches to be that of phases that follow
    the robot.
    """
    feasible = [row for row in rows if np.isfinite(row.following)]
    reached = [
        row.front
        for row in feasible
        if row.front is not None and row.front.distances[-1] < row.following + TIE
    ]
    most = max((int(front.switches[-1]) for front in reached), default=0)
    said = [
        f"In {len(reached)} of the {len(feasible)} rows that have a path, a panel that switches in "
        f"place gives all that one gives that follows the robot, with at most {most} switches."
    ]
    if len(reached) < len(feasible):
        said.append(
            "In the others it gives less: a move needs one configuration that meets the target in "
            "both of its cells, where the paper's map has the best one in each."
        )
    if any(row.metres(most) < row.following - TIE for row in feasible):
        said.append(
            "Where it gives more, phases are rounded: those of another cell may suit a cell better "
            "than its own, of which each was rounded by itself."
        )

    return " ".join(said)


def sizes_table(metres: dict[tuple[float, str], list[float]]) -> str:
    """Metres over the size, a row for each target and design."""
    return table(
        ("target (dB)", "design", *(f"K = {size}" for size in SIZES)),
        [
            (f"{target_db:g}", design, *map(_metres, lengths))
            for (target_db, design), lengths in metres.items()
        ],
    )


def costs_table(rows: Sequence[Row]) -> str:
    """From which cost on the best path has how many switches, a row for each target."""
    cells = []
    for row in rows:
        if row.front is None:
            continue

        front = row.front
        said = [
            f"{front.switches[at]} ({front.distances[at]:.3f} m) from {cost:.3f} m on"
            for cost, at in turning_points(front)
        ]
        cells.append((f"{row.target_db:g}", "; ".join(said)))

    return table(("target (dB)", "switches of the best path, and its length"), cells)


def _metres(metres: float) -> str:
    return f"{metres:.3f}" if np.isfinite(metres) else "none"
