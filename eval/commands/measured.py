"""`python -m eval measured FOLDER`: maps, trade-offs and Pareto fronts of a measured room, and PPO
in it.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional, arg

from eval.markdown import picture, table, template, text
from eval.paper.measured_figures import draw_fronts, draw_means, draw_outages, draw_trade_offs
from eval.paper.measured_room import (
    COSTS,
    LEVEL_DBM,
    RANDOM_START,
    Receiver,
    longest_ways,
    play_ppo,
    read_room,
)
from irs_gym.files import write_file
from irs_gym.radio.fading import MeasuredFading

PLAYED = 3  # receivers


def main(
    folder: Annotated[Positional[Path], arg(metavar="FOLDER", help_behavior_hint="")],
    out: Path = Path("docs"),
    steps: int = 200_000,
    seed: int = 0,
) -> int:
    """Read a measured room, train PPO on three of its receivers, and write a page.

    Writes OUT/measured.md and OUT/figures/measured_*; some minutes of training.

    Parameters
    ----------
    folder
        In the format that `irs_gym.from_rssi_histograms` reads.
    out
        Folder of the page.
    steps
        Steps of PPO's training for each receiver.
    seed
        Seed of PPO.
    """
    try:
        receivers = read_room(folder)
        figures = out / "figures"
        draw_means(receivers, figures)
        draw_outages(receivers, figures)
        draw_trade_offs(receivers, figures)
        draw_fronts(receivers, figures)
        write_file(out / "measured.md", measured_page(receivers, steps, seed).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval measured: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / 'measured.md'}, and {figures}")
    return 0


def measured_page(receivers: Sequence[Receiver], steps: int, seed: int) -> str:
    """The page, once PPO has been trained."""
    first = receivers[0]
    radio_map = first.radio_map
    columns, rows = radio_map.grid.shape
    start = radio_map.grid.centre(first.start)
    goal = radio_map.grid.centre(first.goal)
    fading = radio_map.fading

    return template("measured.md").format(
        columns=columns,
        rows=rows,
        cell_size=radio_map.grid.cell_size,
        free=np.count_nonzero(radio_map.free),
        receivers=len(receivers),
        lowest=fading.levels_db[0] if isinstance(fading, MeasuredFading) else np.nan,
        start=f"({start[0]:g}, {start[1]:g}) m",
        goal=f"({goal[0]:g}, {goal[1]:g}) m",
        means=_map_picture(
            "measured_mean",
            "Mean received power, and a shortest path at the receiver's highest feasible target.",
        ),
        outages=_map_picture(
            "measured_outage",
            f"Share of each cell's histogram below {LEVEL_DBM:g} dBm, and the same paths.",
        ),
        free_distance=first.trade_off.distances[0],
        trade_offs=picture("measured_trade_off", "Shortest distance over the target."),
        level=LEVEL_DBM,
        shadowed=sum(each.fronts["violation"].costs[0] > 0 for each in receivers),
        fronts=picture("measured_fronts", "Pareto fronts of cost and distance, and their hulls."),
        table=_receivers_table(receivers),
        steps=steps,
        random_start=RANDOM_START,
        ppo=_ppo_table(receivers, steps, seed),
    )


def _map_picture(name: str, caption: str) -> str:
    """A picture without its numbers, which are the data of others."""
    return f"![{name.replace('_', ' ')}](figures/{name}.png)\n\n*{caption}*"


def _receivers_table(receivers: Sequence[Receiver]) -> str:
    header = [
        "receiver",
        "highest feasible target (dBm)",
        "distance there (m)",
        *(f"{kind}: least, and its distance (m)" for kind in COSTS),
        *(f"{kind} of the shortest way" for kind in COSTS),
        *(f"points of the front, of the hull: {kind}" for kind in COSTS),
    ]
    rows = []

    for each in receivers:
        fronts = [each.fronts[kind] for kind in COSTS]
        rows.append(
            [
                text(each.name),
                f"{each.highest_target:.2f}",
                f"{each.path.distance:.3f}",
                *(f"{front.costs[0]:.4g}, {front.distances[0]:.3f}" for front in fronts),
                *(f"{front.costs[-1]:.4g}" for front in fronts),
                *(f"{len(front.costs)}, {len(front.hull().costs)}" for front in fronts),
            ]
        )

    return table(header, rows)


def _ppo_table(receivers: Sequence[Receiver], steps: int, seed: int) -> str:
    header = ("receiver", "target (dBm)", "optimum (m)", "PPO (m)", "success", "ratio")
    rows = []

    for each in longest_ways(receivers, PLAYED):
        played = play_ppo(each, steps, seed)
        rows.append(
            (
                text(each.name),
                f"{each.highest_target:.2f}",
                f"{played.oracle_distance:.3f}",
                f"{played.distance:.3f}",
                "yes" if played.is_success else "no",
                "–" if played.ratio is None else f"{played.ratio:.4f}",
            )
        )

    return table(header, rows)
