"""`map_claims`, `path_claims`, `model_claims`: the paper on its maps, its paths, its solution."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from eval.paper.claim import ELEMENTS_AT_DB, PATHS_AT_DB, Claim, statement
from eval.paper.segments import dips_of_map, dips_of_path
from eval.paper.study import CONTINUOUS, ONE_BIT, WITHOUT, Study
from irs_gym.radio.irs import Hardware, channel
from irs_gym.units import Floats, linear_to_db


def map_claims(study: Study) -> list[Claim]:
    """What the paper's Fig. 3 shows."""
    return [_obstacles_are_minus_infinity(study), _shadows_are_abrupt(study), _irs_improves(study)]


def _obstacles_are_minus_infinity(study: Study) -> Claim:
    without = study.radio_map(WITHOUT)
    blocked = ~without.free
    return statement(
        "Fig. 3: in obstacles the gain is minus infinity",
        f"{np.count_nonzero(blocked)} of {blocked.size} cells",
        np.isneginf(without.gain_db[blocked]).all() and blocked.any(),
    )


def _shadows_are_abrupt(study: Study) -> Claim:
    without = study.radio_map(WITHOUT)
    access_point = study.scene.access_points[0].position
    is_clear = study.scene.floor.is_line_of_sight(study.antennas(), access_point)  # (X, Y)
    drops_db = _drops_at_shadows(without.gain_db, without.free, is_clear)

    return statement(
        "Without IRS, the gain degrades severely, and abruptly, where obstacles block the AP",
        f"by {np.mean(drops_db):.1f} dB at a shadow's edge, at least {np.min(drops_db):.1f} dB",
        np.min(drops_db) > 1,
        remark="Between two neighbouring free cells, one in the AP's sight and one not.",
    )


def _irs_improves(study: Study) -> Claim:
    without = study.radio_map(WITHOUT)
    with_irs = study.radio_map(CONTINUOUS)
    free = without.free

    # minus infinity in obstacles of both maps, which has no difference
    raised_db = np.where(free, with_irs.gain_db, 0) - np.where(free, without.gain_db, 0)
    panel = np.array(study.scene.irs_panels[0].position[:2])
    to_irs_m = np.linalg.norm(without.grid.centres() - panel, axis=-1)
    near = raised_db[free & (to_irs_m < 5)]
    far = raised_db[free & (to_irs_m >= 5)]

    return statement(
        "An IRS improves the gain considerably, most of all around itself",
        f"{near.mean():.1f} dB within 5 m of it, {far.mean():.1f} dB beyond, "
        f"up to {raised_db.max():.1f} dB",
        raised_db.min() >= 0 and near.mean() > 2 * far.mean(),
        remark="Means over free cells, continuous phases. No cell loses.",
    )


def path_claims(study: Study) -> list[Claim]:
    """What the paper's Fig. 4 shows."""
    floor = study.scene.grid(study.cell_size).centres()  # (X, Y, 2)
    access_point = np.array(study.scene.access_points[0].position[:2])
    closest = {}
    lengths = {}

    for scheme in (WITHOUT, ONE_BIT, CONTINUOUS):
        path = study.path(scheme, PATHS_AT_DB)
        if path is None:
            closest[scheme] = lengths[scheme] = inf
            continue

        points = floor[tuple(path.cells.T)]  # (T, 2)
        closest[scheme] = np.linalg.norm(points - access_point, axis=-1).min()
        lengths[scheme] = path.distance

    with_irs = min(closest[ONE_BIT], closest[CONTINUOUS])

    return [
        statement(
            f"Fig. 4, {PATHS_AT_DB:g} dB: without IRS the path approaches the AP",
            f"to {closest[WITHOUT]:.2f} m, with IRS {with_irs:.2f} m",
            closest[WITHOUT] < with_irs / 2,
            remark="Horizontal distance of the nearest cell of the path.",
        ),
        statement(
            "and is longer than with IRS, 1 bit or continuous",
            f"{lengths[WITHOUT]:.3f} m against {lengths[ONE_BIT]:.3f} m "
            f"and {lengths[CONTINUOUS]:.3f} m",
            max(lengths[ONE_BIT], lengths[CONTINUOUS]) < lengths[WITHOUT] < inf,
        ),
    ]


def model_claims(study: Study) -> list[Claim]:
    """What Section III says of the solution itself."""
    return [_phases_attain_the_bound(study), _between_waypoints(study)]


def _phases_attain_the_bound(study: Study) -> Claim:
    cells = np.count_nonzero(study.radio_map(CONTINUOUS).free)
    is_equal = _gap_to_bound(study) < 1e-9
    return statement(
        "Eq. (13): the phases of eq. (14) attain the upper bound",
        f"{'to' if is_equal else 'not to'} 1e-9 dB in all {cells} free cells",
        is_equal,
    )


def _between_waypoints(study: Study) -> Claim:
    path = dips_of_path(study, CONTINUOUS, ELEMENTS_AT_DB)
    everywhere = dips_of_map(study, CONTINUOUS, ELEMENTS_AT_DB)
    return statement(
        "Eq. (15c): if two successive waypoints are feasible, so is any point between them",
        f"false on {path.dips} of the {path.moves} moves of the oracle's path",
        path.dips == everywhere.dips == 0,
        is_promised=False,
        remark=f"At {ELEMENTS_AT_DB:g} dB, continuous phases that follow the robot, the gain falls "
        f"up to {path.deepest_db:.2f} dB below the target between two cell centres of that path, "
        f"where it crosses a shadow's edge; of all {everywhere.moves} moves between feasible cells "
        f"{everywhere.dips} dip, by up to {everywhere.deepest_db:.2f} dB. Only the two centres are "
        "tested, by the paper and by us.",
    )


def _drops_at_shadows(
    gain_db: Floats, free: NDArray[np.bool_], is_clear: NDArray[np.bool_]
) -> Floats:
    """Gains in dB of free cells in sight minus those of their free neighbours along x or y that are
    not.
    """
    drops = []
    along_x = ((slice(1, None),), (slice(None, -1),))
    along_y = ((..., slice(1, None)), (..., slice(None, -1)))

    for one, other in (along_x, along_y):
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
