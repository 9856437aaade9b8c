"""`python -m eval shaping`: writes docs/shaping.md, where a discount makes another path than the
shortest the best.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from eval.markdown import page, table, template_sections
from eval.scoreboard.return_variance import best_ratios, count_longer
from irs_gym.datasets.generator import CELL_SIZE
from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.files import write_file
from irs_gym.grid import Cell
from irs_gym.mdp.task import Task, World, build_world
from irs_gym.radio.radio_map import RadioMap

GAMMAS = (0.9, 0.95, 0.98, 0.99, 0.995, 1.0)
OF_MANY = (0.98, 0.99, 1.0)  # discounts for the generated scenes and the spirals
SPIRAL_SIDES = range(5, 45, 2)  # cells

PAGE = "shaping.md"


def main(out: Path = Path("docs"), scenes: int = 1000) -> int:
    """Tell from which starts the path of the largest discounted return is not the shortest, and
    write shaping.md.

    Parameters
    ----------
    out
        Folder of the page.
    scenes
        Scenes of the test split, from the first on.
    """
    try:
        words = template_sections(PAGE)
        text = page(
            words["What a discount makes of the best path"],
            paper_section(),
            generated_section(scenes),
            spirals_section(),
            words["What follows"],
        )
        out.mkdir(parents=True, exist_ok=True)
        write_file(out / "shaping.md", text.encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval shaping: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / 'shaping.md'}")
    return 0


def paper_section() -> str:
    """All starts of the paper's factory, under several discounts."""
    shaped = build_world(Task())
    bare = build_world(Task(shaping=False))
    rows = []

    for gamma in GAMMAS:
        ratios, without = (best_ratios(world, gamma) for world in (shaped, bare))
        rows.append((gamma, count_longer(ratios), _worst(ratios), count_longer(without)))

    starts = int(np.isfinite(best_ratios(shaped, 1.0)).sum())
    header = (
        "discount",
        "starts whose best path is longer",
        "at most so many times",
        "without shaping",
    )

    section = template_sections(PAGE)["The paper's factory"]
    return section.format(target_db=shaped.target_db, starts=starts, rows=table(header, rows))


def generated_section(scenes: int) -> str:
    """Scenes of the test split, under a few discounts."""
    rows = []

    for gamma in OF_MANY:
        own = []
        everywhere = []

        for world in generated_worlds(scenes):
            ratios = best_ratios(world, gamma)  # (X, Y)
            own.append(ratios[world.start])
            everywhere.append(ratios[~np.isnan(ratios)])  # NaN: no start, or the goal itself

        starts = np.concatenate(everywhere)
        rows.append((gamma, count_longer(np.array(own)), count_longer(starts), _worst(starts)))

    header = (
        "discount",
        "scenes whose best path is longer",
        "of all starts",
        "at most so many times",
    )

    section = template_sections(PAGE)["Factories never seen"]
    return section.format(scenes=scenes, rows=table(header, rows))


def spirals_section() -> str:
    """Spirals of all sizes, under a few discounts."""
    rows = []

    for gamma in OF_MANY:
        cells = []
        for shaping in (True, False):
            ratios = np.array(
                [_own_ratio(spiral_world(side, shaping=shaping), gamma) for side in SPIRAL_SIDES]
            )
            cells += [count_longer(ratios), f"{np.isinf(ratios).sum()} of {len(ratios)}"]

        rows.append((gamma, *cells))

    header = (
        "discount",
        "best path is longer",
        "it never arrives",
        "longer without shaping",
        "never without shaping",
    )

    return template_sections(PAGE)["Spirals"].format(
        count=len(SPIRAL_SIDES),
        first=SPIRAL_SIDES[0],
        last=SPIRAL_SIDES[-1],
        rows=table(header, rows),
    )


def generated_worlds(scenes: int) -> Iterable[World]:
    """Worlds of the first scenes of the test split."""
    worlds = build_worlds(RandomTask(scenes=build_scene_set("test", scenes)))
    return track(
        (worlds.world(n) for n in range(len(worlds))), "scenes", total=len(worlds), transient=True
    )


def spiral_world(side: int, *, shaping: bool = True) -> World:
    """The way through a spiral, from its outer corner to its centre."""
    cells = spiral(side)

    # walls are obstacles, the corridor is above any target below 0 dB
    gain_db = np.full((side, side), -np.inf)
    gain_db[tuple(np.array(cells).T)] = 0.0
    radio_map = RadioMap.from_array(gain_db, CELL_SIZE)

    return build_world(
        Task(radio_map=radio_map, start=cells[0], goal=cells[-1], target_db=-1.0, shaping=shaping)
    )


def spiral(side: int) -> list[Cell]:
    """Cells of a corridor that winds from the corner of a square to its centre, with walls a cell
    thick.
    """
    i = 0
    j = 0
    di = 1
    dj = 0
    cells = [(0, 0)]
    has_turned = False

    while True:
        ahead = (i + di, j + dj)
        beyond = (i + 2 * di, j + 2 * dj)  # a wall stays between two windings
        if 0 <= ahead[0] < side and 0 <= ahead[1] < side and beyond not in cells:
            i, j = ahead
            cells.append(ahead)
            has_turned = False
        elif has_turned:  # neither ahead nor to the left: the centre
            return cells
        else:
            di, dj = -dj, di  # to the left
            has_turned = True


def _own_ratio(world: World, gamma: float) -> float:
    return float(best_ratios(world, gamma)[world.start])


def _worst(ratios: NDArray[np.float64]) -> str:
    worst = np.nanmax(ratios)
    return f"{worst:.3f}" if np.isfinite(worst) else "never arrives"
