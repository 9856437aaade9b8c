"""`draw_gallery`: where policies do well and where they fail, each beside the oracle's path, as a
PNG.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.rollout.episode import EpisodeResult
from eval.pictures import add_legend, as_png, literal
from eval.scoreboard.overlay import BROAD, RIM, draw_ends, draw_map
from irs_gym.mdp.task import World

COLUMNS = 4


@dataclass(frozen=True, eq=False)
class Scenery:
    """One picture: a policy's episode, and the cells of the oracle's path."""

    policy: str
    scene: str
    world: World
    episode: EpisodeResult
    oracle: NDArray[np.int64]


def choose(spl: NDArray[np.float64], detour: NDArray[np.float64]) -> list[int]:
    """Numbers of two scenes with the longest detours among those solved well, and of two with the
    lowest SPL.
    """
    well = np.flatnonzero(spl > 0.95)
    best = well[np.argsort(-detour[well], kind="stable")][: COLUMNS // 2]
    return [*best.tolist(), *np.lexsort((-detour, spl))[: COLUMNS // 2].tolist()]


def draw_gallery(sceneries: Sequence[Scenery]) -> bytes:
    """Pictures in rows of four, the oracle's path in white."""
    rows = -(-len(sceneries) // COLUMNS)
    figure = Figure(figsize=(3.0 * COLUMNS, 3.35 * rows + 0.4), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()

    for each, place in zip(sceneries, axes, strict=False):
        draw_map(place, each.world)
        centres = each.world.radio_map.grid.centres()
        oracle = place.plot(*centres[tuple(each.oracle.T)].T, label="oracle", **BROAD)[0]
        oracle.set_path_effects(RIM)
        place.plot(
            *centres[tuple(each.episode.path.T)].T, color="tab:red", linewidth=2.0, label="policy"
        )
        draw_ends(place, each.world, size=6.0)
        ratio = each.episode.ratio
        result = "goal not reached" if ratio is None else f"{ratio:.3f} times the oracle's"
        place.set_title(
            f"{literal(each.policy)}\n{literal(each.scene)}: {result}", fontsize="small"
        )
        place.set(xticks=[], yticks=[])

    for place in axes[len(sceneries) :]:
        place.set_visible(False)

    add_legend(figure, axes[0].get_legend_handles_labels()[0])

    return as_png(figure, dpi=80, in_palette=True)
