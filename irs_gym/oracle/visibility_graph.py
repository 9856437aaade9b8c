"""`search`: shortest ways over the corners of the infeasible area, along lines of sight."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from irs_gym.oracle.sight import Points, Sight, blocked_around, corner_contacts


def corners_of(
    feasible: NDArray[np.bool_], corner_cutting: bool = True
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points where a shortest path may bend, ``(n, 2)``, and the sign of the slopes dy/dx that it
    may have there.

    Of the four cells around such a point, the infeasible ones lie on one diagonal: one of them at a
    reflex corner, two where feasible cells touch at a corner only. A taut path neither enters them
    nor could be pulled straight, so its pieces run in the quadrants of the other diagonal, both on
    their way in and out.
    """
    south_west, south_east, north_west, north_east = blocked_around(feasible)

    # Infeasible cells on one diagonal alone: the path bends around them, along the other one.
    rising = south_west | north_east
    falling = south_east | north_west
    slope = np.where(falling, 1, -1) * (rising != falling)
    if not corner_cutting:  # no path passes where cells touch at a corner, so none bends there
        slope[corner_contacts(feasible)] = 0

    return np.argwhere(slope), slope[slope != 0]


def is_taut(apart: Points, slopes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether pieces of a path that lie ``(..., 2)`` apart may end in corners of such slopes
    ``(...)``; all may where it is 0.
    """
    return np.asarray(np.sign(apart[..., 0]) * np.sign(apart[..., 1]) * slopes >= 0)


def search(
    sight: Sight,
    points: Points,
    slopes: NDArray[np.int64],
    target: int | None = None,
    *,
    longest: float = inf,
    leaves: int = 0,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Shortest ways from the first point along lines of sight: by the A* algorithm to one point, or
    by Dijkstra's to all.

    Parameters
    ----------
    sight
        Tells which points see each other.
    points, slopes
        Shapes ``(n, 2)`` in cells, and ``(n,)``: corners as `corners_of` gives them, and others,
        whose slope is 0.
    target
        The point that is looked for, or None: all.
    longest
        Lines of sight are tested only where they may lie on a taut way no longer than this.
    leaves
        So many points at the end are ends only: no way leads over them.

    Returns
    -------
    Lengths in cells ``(n,)``, inf where no way was found, and the point before each on its way, -1
    where there is none.
    """
    # never longer than the way that is left
    left = np.zeros(len(points)) if target is None else np.hypot(*(points - points[target]).T)
    reached = np.where(np.arange(len(points)) == 0, 0.0, inf)
    before = np.full(len(points), -1)
    is_passed = np.arange(len(points)) >= len(points) - leaves

    while True:
        # the point whose way from the start, and straight on to the target, is the shortest
        here = int(np.argmin(np.where(is_passed, inf, reached + left)))
        if here == target or is_passed[here] or reached[here] == inf:
            return reached, before
        is_passed[here] = True

        # which points could be next, and closer than by other ways
        apart = points - points[here]  # (n, 2)
        length = reached[here] + np.hypot(*apart.T)
        is_next = (length < reached) & (length + left <= longest * (1 + 1e-12))
        ahead = np.flatnonzero(is_next)
        ahead = ahead[is_taut(apart[ahead], slopes[ahead]) & is_taut(apart[ahead], slopes[here])]

        # and which of them can be seen from here
        ahead = ahead[sight.between(np.broadcast_to(points[here], (len(ahead), 2)), points[ahead])]
        reached[ahead] = length[ahead]
        before[ahead] = here
