"""`python -m eval headroom`: writes docs/headroom.md, what policies of the local track make in
small families of rooms, beside the most that any could.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from eval.markdown import Promise, page, picture, promises, table, template
from eval.paper.figures import GOAL, START, new_figure, save
from eval.unseen.headroom import REPLANNING, Headroom, headroom_of, path_of, policies
from eval.unseen.small_families import (
    CELL_SIZE,
    SmallFamily,
    drawn_families,
    listed_families,
)
from irs_gym.files import write_file

PAGE = "headroom.md"
FIGURE = "headroom"
DRAWN_FAMILY = "rooms"  # in the figure
CLOSED: dict[str, Any] = {"fill": False, "hatch": "////", "edgecolor": "#666666", "linewidth": 0.8}
RADII = (1, 2)
PARTS = (8, 4, 2, 1)  # of the list of rooms that are drawn
LEAST_DRAWN = 64

Found = Mapping[tuple[str, int], Headroom]
"""By family and radius."""


def main(
    out: Path = Path("docs"),
    drawn: int = 512,
    max_states: int = 100_000,
    most_played: int = 5000,
) -> int:
    """Compute the belief optimum of each small family, play the policies, and write headroom.md.

    Takes some twenty minutes of a core, nearly all of them for the explorers.

    Parameters
    ----------
    out
        Folder of the page.
    drawn
        Rooms that are drawn of a family that cannot be listed, 64 or more.
    max_states
        Beliefs in cells that are looked at for one optimum; where they are not enough, it is
        bounded.
    most_played
        Rooms of the largest family that explorers play in.
    """
    try:
        if drawn < LEAST_DRAWN:
            raise ValueError(f"drawn={drawn} must be {LEAST_DRAWN} or more")

        limits = (max_states, most_played)
        listed = _found(listed_families(), *limits)
        growing = [_found(drawn_families(drawn // part), max_states, 0) for part in PARTS[:-1]]
        sampled = _found(drawn_families(drawn), *limits)
        growing.append(sampled)

        _draw(listed[DRAWN_FAMILY, 1], out / "figures")
        write_file(out / PAGE, headroom_page(listed, sampled, growing).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval headroom: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / PAGE}, and {out / 'figures'}")
    return 0


def _found(families: Mapping[str, SmallFamily], max_states: int, most_played: int) -> Found:
    players = policies()
    replanning = {REPLANNING: players[REPLANNING]}

    return {
        (name, radius): headroom_of(
            family, radius, players if len(family) <= most_played else replanning, max_states
        )
        for name, family in families.items()
        for radius in RADII
    }


def headroom_page(listed: Found, sampled: Found, growing: list[Found]) -> str:
    """The page, with what is computed in its places."""
    everything = {**listed, **sampled}
    words = template(PAGE).format(
        cell=CELL_SIZE,
        listed=_spl_table(listed),
        unplayed=_unplayed(everything),
        words="\n".join(f"| {name} | {text} |" for name, text in _words(everything).items()),
        metres=_metres_table(listed),
        growth=_growth_table(growing),
        drawn=_spl_table(sampled),
        picture=picture(FIGURE, _caption(listed[DRAWN_FAMILY, 1])),
        promises=promises(_promises(everything)),
        work=_work_table(everything),
    )

    return page(words)


def _words(found: Found) -> dict[str, str]:
    return {name: each.family.words for (name, _), each in found.items()}


def _spl_table(found: Found) -> str:
    titles = _titles(found)
    header = ("family", "radius", "belief optimum", *titles, "over replanning", "over the best")
    rows = [
        (
            name,
            radius,
            _value(each),
            *(f"{each.spl(title):.4f}" if title in each.played else "" for title in titles),
            f"{each.best_spl.bound - each.spl(REPLANNING):+.4f}",
            f"{each.best_spl.bound - each.highest:+.4f}",
        )
        for (name, radius), each in found.items()
    ]

    return table(header, rows)


def _unplayed(found: Found) -> str:
    """Where explorers were not played."""
    titles = _titles(found)
    least = [len(each.family) for each in found.values() if len(each.played) < len(titles)]
    return f"Explorers were not played in families of {min(least)} rooms or more." if least else ""


def _titles(found: Found) -> list[str]:
    """Of all policies that were played in some family."""
    return list(dict.fromkeys(title for each in found.values() for title in each.played))


def _value(each: Headroom) -> str:
    """The optimum, or what it lies between."""
    best = each.best_spl
    if best.is_exact:
        return f"{best.value:.4f}"
    return f"{best.value:.4f} to {best.bound:.4f}"


def _metres_table(found: Found) -> str:
    titles = _titles(found)
    rows = [
        (
            name,
            radius,
            f"{each.best_spl.oracle_distances @ each.family.weights:.3f}",
            f"{each.best_distance.bound:.3f}" + ("" if each.best_distance.is_exact else " or more"),
            *(f"{each.distance(title):.3f}" if title in each.played else "" for title in titles),
        )
        for (name, radius), each in found.items()
    ]

    return table(("family", "radius", "room known", "belief optimum", *titles), rows)


def _growth_table(growing: list[Found]) -> str:
    rows = [
        (
            name,
            radius,
            len(each.family),
            _value(each),
            f"{each.spl(REPLANNING):.4f}",
            f"{each.best_spl.bound - each.spl(REPLANNING):+.4f}",
        )
        for name, radius in growing[0]
        for each in (found[name, radius] for found in growing)
    ]

    return table(
        ("family", "radius", "rooms", "belief optimum", REPLANNING, "over replanning"), rows
    )


def _work_table(found: Found) -> str:
    rows = [
        (
            name,
            "{} x {}".format(*each.family.feasible.shape[1:]),
            f"{len(each.family):,}",
            radius,
            f"{each.best_spl.states:,}",
            f"{each.best_distance.states:,}",
            f"{each.seconds:.1f}",
        )
        for (name, radius), each in found.items()
    ]

    return table(
        ("family", "cells", "rooms", "radius", "states, SPL", "states, metres", "seconds, both"),
        rows,
    )


def _promises(found: Found) -> list[Promise]:
    kept = [each.is_bound_kept for each in found.values()]
    exact = [each.best_spl.is_exact and each.best_distance.is_exact for each in found.values()]
    further = [
        found[name, RADII[1]].best_spl.bound - found[name, RADII[0]].best_spl.value
        for name, radius in found
        if radius == RADII[0]
    ]

    return [
        Promise("no policy exceeds the belief optimum", f"{sum(kept)} of {len(kept)}", all(kept)),
        Promise("value and bound are one", f"{sum(exact)} of {len(exact)}", all(exact)),
        Promise(
            "who sees further is never worse",
            f"least gain {min(further):+.4f}",
            min(further) >= 0,
        ),
    ]


# --- the figure -----------------------------------------------------------------------------------


def _shown(each: Headroom) -> int:
    """The room in which the optimum gains the most."""
    return int(np.argmax(each.best_spl.spl - each.played[REPLANNING].spl))


def _caption(each: Headroom) -> str:
    scene = _shown(each)
    ours, theirs = each.best_spl.distances[scene], each.played[REPLANNING].distance[scene]
    is_shorter = each.best_spl.distances < each.played[REPLANNING].distance - 1e-9
    is_longer = each.best_spl.distances > each.played[REPLANNING].distance + 1e-9

    return (
        f'A room of the family "{DRAWN_FAMILY}" at a radius of {each.radius}: the belief optimum '
        f"walks {ours:.2f} m, optimistic replanning {theirs:.2f} m. It is shorter in "
        f"{100 * is_shorter @ each.family.weights:.0f} % of the rooms, longer in "
        f"{100 * is_longer @ each.family.weights:.0f} %."
    )


def _draw(each: Headroom, folder: Path) -> None:
    """Both paths in one room, over how likely cells are closed."""
    family = each.family
    scene = _shown(each)
    closed = 1.0 - np.tensordot(family.weights, family.feasible, axes=1)  # (X, Y)
    paths = {
        "belief optimum": each.best_spl.path(scene).cells,
        REPLANNING: path_of(each.played[REPLANNING], scene, family.start),
    }
    lengths = (each.best_spl.distances[scene], each.played[REPLANNING].distance[scene])
    columns, rows = closed.shape

    with new_figure(9.0, 5.0) as figure:
        for axes, (title, cells), metres in zip(
            figure.subplots(1, 2, sharey=True), paths.items(), lengths, strict=True
        ):
            axes.imshow(
                closed.T,
                origin="lower",
                cmap="Greys",
                vmin=0,
                vmax=1.5,
                extent=(0, columns, 0, rows),
            )
            for i, j in np.argwhere(~family.feasible[scene]).tolist():
                axes.add_patch(Rectangle((i, j), 1, 1, **CLOSED))

            # each lap a little to the side, so that the way back is seen
            lap = np.linspace(-0.15, 0.15, len(cells))[:, None]
            x, y = (cells + 0.5 + lap).T
            axes.plot(x, y, color="#08306b", linewidth=2.0, marker=".")
            axes.plot(*(np.array(family.start) + 0.5), **START)
            axes.plot(*(np.array(family.goal) + 0.5), **GOAL)
            axes.set(title=f"{title}: {metres:.2f} m", xlabel="i (cells)", ylabel="j (cells)")

        steps = [
            (title, n, int(i), int(j))
            for title, cells in paths.items()
            for n, (i, j) in enumerate(cells.tolist())
        ]
        save(figure, folder, FIGURE, ("policy", "step", "i", "j"), steps)
