"""`map_claims`, `path_claims`, `model_claims`: what the paper says of its maps, its paths and its
solution.
"""

from math import inf

import numpy as np
from numpy.typing import NDArray

from eval.paper.claim import ELEMENTS_AT_DB, PATHS_AT_DB, Claim
from eval.paper.segments import dips_of_map, dips_of_path
from eval.paper.study import CONTINUOUS, ONE_BIT, WITHOUT, Study
from irs_gym.radio.geometry import is_line_of_sight
from irs_gym.radio.irs import Hardware, channel
from irs_gym.units import Floats, linear_to_db


def map_claims(study: Study) -> list[Claim]:
    """What the paper's Fig. 3 shows."""
    scene = study.scene
    without = study.radio_map(WITHOUT)
    with_irs = study.radio_map(CONTINUOUS)
    free = without.free
    floor = without.grid.centres()
    is_clear = is_line_of_sight(study.antennas(), scene.access_points[0].position, scene.boxes)
    drops = _drops_at_shadows(without.gain_db, free, is_clear)
    gain = np.where(free, with_irs.gain_db, 0) - np.where(free, without.gain_db, 0)
    to_irs = np.linalg.norm(floor - np.array(scene.irs_panels[0].position[:2]), axis=-1)
    near = gain[free & (to_irs < 5)]
    far = gain[free & (to_irs >= 5)]

    return [
        Claim(
            "Fig. 3: in obstacles the gain is minus infinity",
            "",
            (f"{np.count_nonzero(~free)} of {free.size} cells",),
            "",
            bool(np.isneginf(without.gain_db[~free]).all() and (~free).any()),
            True,
        ),
        Claim(
            "Without IRS, the gain degrades severely, and abruptly, where obstacles block the AP",
            "",
            (f"by {np.mean(drops):.1f} dB at a shadow's edge, at least {np.min(drops):.1f} dB",),
            "",
            bool(np.min(drops) > 1),
            True,
            "Between two neighbouring free cells, one in the AP's sight and one not.",
        ),
        Claim(
            "An IRS improves the gain considerably, most of all around itself",
            "",
            (
                f"{near.mean():.1f} dB within 5 m of it, {far.mean():.1f} dB beyond, up to {gain.max():.1f} dB",
            ),
            "",
            bool(gain.min() >= 0 and near.mean() > 2 * far.mean()),
            True,
            "Means over free cells, continuous phases. No cell loses.",
        ),
    ]


def path_claims(study: Study) -> list[Claim]:
    """What the paper's Fig. 4 shows."""
    floor = study.scene.grid(study.cell_size).centres()
    ap = np.array(study.scene.access_points[0].position[:2])
    closest = {}
    lengths = {}

    for scheme in (WITHOUT, ONE_BIT, CONTINUOUS):
        path = study.path(scheme, PATHS_AT_DB)
        lengths[scheme] = inf if path is None else path.distance
        closest[scheme] = (
            inf if path is None else np.linalg.norm(floor[tuple(path.cells.T)] - ap, axis=-1).min()
        )

    with_irs = min(closest[ONE_BIT], closest[CONTINUOUS])

    return [
        Claim(
            f"Fig. 4, {PATHS_AT_DB:g} dB: without IRS the path approaches the AP",
            "",
            (f"to {closest[WITHOUT]:.2f} m, with IRS {with_irs:.2f} m",),
            "",
            bool(closest[WITHOUT] < with_irs / 2),
            True,
            "Horizontal distance of the nearest cell of the path.",
        ),
        Claim(
            "and is longer than with IRS, 1 bit or continuous",
            "",
            (
                f"{lengths[WITHOUT]:.3f} m against {lengths[ONE_BIT]:.3f} m and {lengths[CONTINUOUS]:.3f} m",
            ),
            "",
            bool(max(lengths[ONE_BIT], lengths[CONTINUOUS]) < lengths[WITHOUT] < inf),
            True,
        ),
    ]


def model_claims(study: Study) -> list[Claim]:
    """What Section III says of the solution itself."""
    bound = study.radio_map(CONTINUOUS).gain_db
    free = np.isfinite(bound)
    path = dips_of_path(study, CONTINUOUS, ELEMENTS_AT_DB)
    everywhere = dips_of_map(study, CONTINUOUS, ELEMENTS_AT_DB)
    gap = _gap_to_bound(study)

    return [
        Claim(
            "Eq. (13): the phases of eq. (14) attain the upper bound",
            "",
            (
                f"{'to' if gap < 1e-9 else 'not to'} 1e-9 dB in all {np.count_nonzero(free)} free cells",
            ),
            "",
            bool(gap < 1e-9),
            True,
        ),
        Claim(
            "Eq. (15c): if two successive waypoints are feasible, so is any point between them",
            "",
            (f"false on {path.dips} of the {path.moves} moves of the oracle's path",),
            "",
            path.dips == everywhere.dips == 0,
            False,
            f"At {ELEMENTS_AT_DB:g} dB, continuous phases that follow the robot, the gain falls up to "
            f"{path.deepest_db:.2f} dB below the target between two cell centres of that path, where it crosses a "
            f"shadow's edge; of all {everywhere.moves} moves between feasible cells {everywhere.dips} dip, by up to "
            f"{everywhere.deepest_db:.2f} dB. Only the two centres are tested, by the paper and by us.",
        ),
    ]


def _drops_at_shadows(
    gain_db: Floats, free: NDArray[np.bool_], is_clear: NDArray[np.bool_]
) -> Floats:
    """Gains in dB of free cells in sight minus those of their free neighbours along x or y that are
    not.
    """
    drops = []

    for one, other in (
        ((slice(1, None),), (slice(None, -1),)),
        ((..., slice(1, None)), (..., slice(None, -1))),
    ):
        for clear, shadow in ((one, other), (other, one)):
            edge = free[clear] & free[shadow] & is_clear[clear] & ~is_clear[shadow]
            drops.append(gain_db[clear][edge] - gain_db[shadow][edge])

    return np.concatenate(drops)


def _gap_to_bound(study: Study) -> float:
    """Largest distance in dB, over the free cells, of the upper bound from the gain with the phases
    put in.
    """
    positions = study.antennas()[study.radio_map(CONTINUOUS).free]
    site = channel(study.scene, study.scene.access_points[0], positions)
    turned = site.reflected_los("far_field") * np.exp(1j * site.phase_shifts(Hardware()))
    gain = np.abs(site.direct_los + turned.sum(axis=1)) ** 2 + site.scattered_power()

    return float(np.abs(linear_to_db(gain) - linear_to_db(site.expected_gain(Hardware()))).max())
