"""`draw_gallery`: where policies do well and where they fail, each beside the oracle's path, as a
PNG.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.rollout.episode import EpisodeResult
from eval.pictures import add_legend, as_png, literal
from eval.scoreboard.overlay import BROAD, RIM, draw_ends, draw_feasible_map
from irs_gym.mdp.task import World

COLUMNS = 4
_TITLE_LETTERS = 36  # in a line: as wide as a picture


@dataclass(frozen=True, eq=False)
class Scenery:
    """One picture: a policy's episode, and the cells of the oracle's path."""

    policy: str
    scene: str
    world: World
    episode: EpisodeResult
    oracle: NDArray[np.int64]


def choose_scenes(spl: NDArray[np.float64], detour: NDArray[np.float64]) -> list[int]:
    """Numbers of two scenes with the longest detours among those solved well, and of two with the
    lowest SPL.
    """
    well = np.flatnonzero(spl > 0.95)
    best = well[np.argsort(-detour[well], kind="stable")][: COLUMNS // 2]
    worst = np.lexsort((-detour, spl))[: COLUMNS // 2]  # of equal SPL, the longest detours first

    return [*best.tolist(), *worst.tolist()]


def draw_gallery(sceneries: Sequence[Scenery]) -> bytes:
    """Pictures in rows of four, the oracle's path in white."""
    rows = -(-len(sceneries) // COLUMNS)
    figure = Figure(figsize=(3.0 * COLUMNS, 3.35 * rows + 0.4), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()

    for each, place in zip(sceneries, axes, strict=False):
        _draw_scenery(place, each)

    for place in axes[len(sceneries) :]:
        place.set_visible(False)

    add_legend(figure, axes[0].get_legend_handles_labels()[0])

    return as_png(figure, dpi=80, in_palette=True)


def _draw_scenery(axes: Axes, scenery: Scenery) -> None:
    """One picture: the oracle's path below the policy's, and the ratio of their lengths."""
    draw_feasible_map(axes, scenery.world)
    centres = scenery.world.radio_map.grid.centres()  # (X, Y, 2)

    oracle = axes.plot(*centres[tuple(scenery.oracle.T)].T, label="oracle", **BROAD)[0]
    oracle.set_path_effects(RIM)
    path = centres[tuple(scenery.episode.path.T)]  # (T, 2)
    axes.plot(*path.T, color="tab:red", linewidth=2.0, label="policy")
    draw_ends(axes, scenery.world, size=6.0)

    ratio = scenery.episode.ratio
    result = "goal not reached" if ratio is None else f"{ratio:.3f} times the oracle's"
    name = fill(literal(scenery.policy), _TITLE_LETTERS)
    title = f"{name}\n{literal(scenery.scene)}: {result}"
    axes.set_title(title, fontsize="small")
    axes.set(xticks=[], yticks=[])
