"""Facts of decibels and wavelengths."""

import math

import numpy as np
import pytest

from irs_gym.units import SPEED_OF_LIGHT, db_to_linear, linear_to_db, wavelength_m


@pytest.mark.parametrize(
    ("value_db", "ratio"), [(0.0, 1.0), (10.0, 10.0), (-30.0, 1e-3), (-math.inf, 0.0)]
)
def test_decibels_are_ten_times_the_logarithm_of_a_power_ratio(value_db, ratio):
    assert db_to_linear(value_db) == pytest.approx(ratio, rel=1e-15)
    assert linear_to_db(ratio) == pytest.approx(value_db, rel=1e-15)


def test_decibels_survive_the_round_trip_in_any_shape():
    values_db = np.linspace(-150, 50, 60).reshape(3, 4, 5)
    assert np.allclose(linear_to_db(db_to_linear(values_db)), values_db, rtol=0, atol=1e-12)


def test_a_ratio_of_zero_is_minus_infinity_without_a_warning(recwarn):
    assert linear_to_db(np.array([0.0, 1.0])).tolist() == [-math.inf, 0.0]
    assert not recwarn.list


def test_whole_numbers_are_taken_for_real_ones():
    assert db_to_linear([10, 20]).tolist() == [10.0, 100.0]


def test_wavelength_at_the_papers_carrier():
    assert SPEED_OF_LIGHT == 299_792_458
    assert wavelength_m(2.0) == 299_792_458 / 2e9 == pytest.approx(0.149896229, rel=1e-15)
