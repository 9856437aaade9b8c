"""Facts of single links: the paper's path loss, blockage and Rician factor."""

from math import log10, sqrt

import numpy as np
import pytest

from irs_gym.radio.propagation import link, path_loss_db
from irs_gym.radio.scene import Obstacle, load_scene

PAPER = load_scene("paper")
TWO_GHZ = 19 * log10(2)


def loss(distance, is_clear, carrier_ghz=2.0) -> float:
    return float(path_loss_db(distance, np.array(is_clear), PAPER.path_loss, carrier_ghz))


@pytest.mark.parametrize(
    ("distance", "loss_db"), [(1, 31.84), (10, 53.34), (100, 74.84), (sqrt(10), 42.59)]
)
def test_path_loss_with_line_of_sight(distance, loss_db):
    assert loss(distance, True) == pytest.approx(loss_db + TWO_GHZ, abs=1e-12)
    assert loss(distance, True, carrier_ghz=1.0) == pytest.approx(loss_db, abs=1e-12)


@pytest.mark.parametrize(("distance", "loss_db"), [(1, 32.4), (10, 55.4), (100, 78.4)])
def test_path_loss_without_line_of_sight(distance, loss_db):
    assert loss(distance, False) == pytest.approx(loss_db + 20 * log10(2), abs=1e-12)


def test_a_blocked_link_never_loses_less():
    distances = np.geomspace(1e-3, 1e3, 200)
    for carrier_ghz in (0.05, 1.0, 2.0, 60.0):
        clear, blocked = (
            path_loss_db(distances, np.full(200, is_clear), PAPER.path_loss, carrier_ghz)
            for is_clear in (True, False)
        )
        assert (blocked >= clear).all()
    # near by, the other formula alone would be below
    assert (
        32.4 + 23 * log10(0.01) < 31.84 + 21.5 * log10(0.01) == loss(0.01, False, carrier_ghz=1.0)
    )


def test_path_loss_grows_with_distance():
    distances = np.geomspace(0.1, 100, 50)
    for is_clear in (True, False):
        assert (
            np.diff(path_loss_db(distances, np.full(50, is_clear), PAPER.path_loss, 2.0)) > 0
        ).all()


def test_a_clear_link_is_rician_and_a_blocked_one_is_rayleigh():
    # over the floor in front of the box at (0, 0), and behind it as the access point sees it
    ends = link(
        PAPER, np.array([[0.25, 2.75, 1.0], [0.25, -2.75, 1.0]]), PAPER.access_points[0].position
    )
    assert ends.rician_factor == pytest.approx([10**0.3, 0.0], rel=1e-15)
    distances = [sqrt(0.25**2 + 7.25**2 + 1), sqrt(0.25**2 + 12.75**2 + 1)]
    assert ends.distance_m == pytest.approx(distances, rel=1e-15)
    losses = [loss(distances[0], True), loss(distances[1], False)]
    assert -10 * np.log10(ends.path_gain) == pytest.approx(losses, rel=1e-15)
    assert ends.los_amplitude[1] == 0.0


def test_steady_and_scattered_power_add_up_to_the_path_gain():
    points = np.random.default_rng(0).uniform((-10, -10, 0), (10, 9, 5), (100, 3))
    ends = link(PAPER, points, PAPER.access_points[0].position)
    assert 0 < np.count_nonzero(ends.rician_factor) < 100
    assert ends.los_amplitude**2 + ends.scattered_power == pytest.approx(ends.path_gain, rel=1e-14)
    clear = ends.rician_factor > 0
    assert ends.los_amplitude[clear] ** 2 / ends.scattered_power[clear] == pytest.approx(
        10**0.3, rel=1e-14
    )


def test_directions_are_unit_vectors_from_the_common_end():
    ends = link(PAPER, np.array([[3.0, -6.0, 2.0], [0.0, -10.0, 5.0]]), (0.0, -10.0, 2.0))
    assert ends.direction == pytest.approx(np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]), abs=1e-15)
    assert ends.distance_m == pytest.approx([5.0, 3.0])


def test_a_link_keeps_the_shape_of_its_points():
    assert link(PAPER, np.ones((4, 3, 3)), (0.0, 10.0, 2.0)).path_gain.shape == (4, 3)
    assert link(PAPER, np.ones(3), (0.0, 10.0, 2.0)).path_gain.shape == ()


def test_the_link_between_access_point_and_panel_can_be_blocked():
    ap, panel = np.array(PAPER.access_points[0].position), PAPER.irs_panels[0].position
    assert link(PAPER, ap, panel).rician_factor == pytest.approx(10**0.3)
    tall = Obstacle(center=(0.0, 0.0), size=(4.0, 4.0, 2.5))
    walled = PAPER.model_copy(update={"obstacles": (tall,)})
    assert link(walled, ap, panel).rician_factor == 0.0
    assert -10 * np.log10(link(walled, ap, panel).path_gain) == pytest.approx(loss(20.0, False))


def test_an_antenna_on_top_of_another_is_refused():
    with pytest.raises(ValueError, match=r"an antenna at \(0.0, 10.0, 2.0\) m coincides"):
        link(PAPER, np.array([[1.0, 1.0, 1.0], [0.0, 10.0, 2.0]]), (0.0, 10.0, 2.0))
