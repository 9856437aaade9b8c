"""Facts of the packed states of many scenes: what goes in comes out, and moves are additions."""

import numpy as np
import pytest

from irs_gym.grid import MOVES
from irs_gym.vector.state_code import MOST_PLACES, MoveBits, StateCode, by_code, pack_moves

CODES = [
    StateCode(shape=(5, 6), frame=(4, 5)),
    StateCode(shape=(2, 2), frame=(1, 1)),
    StateCode(shape=(125, 45), frame=(120, 40)),
]


def some(code, n=2000, seed=0):
    """Scenes, cells and goals."""
    rng = np.random.default_rng(seed)
    most = MOST_PLACES // code.map_size
    return (
        np.append(rng.integers(most, size=n - 1), most - 1),
        rng.integers(code.frame, size=(n, 2)),
        rng.integers(code.frame, size=(n, 2)),
    )


@pytest.mark.parametrize("code", CODES)
def test_states_say_scene_cell_and_goal(code):
    scenes, cells, goals = some(code)
    robots = code.decode(code.encode(scenes, cells, goals))
    np.testing.assert_array_equal(robots.scene, scenes)
    np.testing.assert_array_equal(robots.cell, cells)
    np.testing.assert_array_equal(robots.goal, goals)


@pytest.mark.parametrize("code", CODES)
def test_a_step_adds_the_move_or_nothing_where_it_is_refused(code):
    scenes, cells, goals = some(code)
    actions = np.arange(len(scenes)) % 8
    ends = cells + MOVES[actions]
    is_legal = ((ends >= 0) & (ends < code.frame)).all(axis=1)
    found = code.step(code.encode(scenes, cells, goals), 2 * actions + is_legal)
    expected = code.encode(scenes, np.where(is_legal[:, None], ends, cells), goals)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("code", CODES)
def test_rows_of_tables_go_by_offset_and_code(code):
    scenes, cells, goals = some(code)
    states = code.encode(scenes, cells, goals)
    np.testing.assert_array_equal(code.all_offsets[code.offsets(states)], cells - goals)
    moves = np.arange(len(scenes)) % 16
    table = np.arange(len(code.all_offsets) * 16).reshape(-1, 16)
    entries = code.entries(states, moves)
    np.testing.assert_array_equal(table.ravel()[entries], table[code.offsets(states), moves])


def test_bits_of_moves_are_those_that_were_packed():
    rng = np.random.default_rng(1)
    is_set = rng.random((300, 8)) < 0.5
    bits = MoveBits(pack_moves(is_set))
    places, actions = rng.integers(300, size=1000), rng.integers(8, size=1000)
    assert len(bits) == 300
    np.testing.assert_array_equal(bits.of(places, actions), is_set[places, actions])
    np.testing.assert_array_equal(bits.of_all(places), is_set[places])
    codes = bits.codes(places, actions)
    np.testing.assert_array_equal(codes, 2 * actions + is_set[places, actions])
    table = by_code(-1, np.arange(8))
    done = np.where(is_set[places, actions], actions, -1)
    np.testing.assert_array_equal(table[codes], done)
