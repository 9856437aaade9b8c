"""Facts of limits: work is refused by name, before it begins, where it would take more memory than
is allowed.
"""

import gymnasium
import numpy as np
import pytest

from irs_gym import (
    build_phase_shifts,
    build_radio_map,
    load_scene,
    shortest_path,
    straight_line_bound,
)
from irs_gym.datasets.scene_set import build_scene_set, scene_set_of
from irs_gym.memory import MemoryLimitError, check_memory, memory_limit
from irs_gym.radio.scene import Scene

ID, RANDOM = "irs_gym:IrsNav-v0", "irs_gym:IrsNavRandom-v0"
PAPER = load_scene("paper")


@pytest.fixture(autouse=True)
def one_gibibyte(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "1GiB")


def huge() -> Scene:
    """A room of 1,000 km."""
    room = {**PAPER.room.model_dump(), "x_min": -5e5, "x_max": 5e5}
    return Scene.model_validate({**PAPER.model_dump(), "room": room})


@pytest.mark.parametrize(
    ("given", "limit"),
    [("8GiB", 2**33), ("1.5 KiB", 1536), ("300", 300), ("2TiB", 2**41), (" 7 MiB ", 7 * 2**20)],
)
def test_the_limit_is_what_the_variable_says(monkeypatch, given, limit):
    monkeypatch.setenv("IRS_GYM_MEMORY", given)
    assert memory_limit() == limit


@pytest.mark.parametrize("given", ["0", "-1", "much", "8GB", "nan", "1e9", "9" * 400])
def test_a_limit_that_is_no_number_of_bytes_is_refused(monkeypatch, given):
    monkeypatch.setenv("IRS_GYM_MEMORY", given)
    with pytest.raises(
        ValueError, match=r"IRS_GYM_MEMORY='.*' must be a positive number of bytes, such as"
    ):
        memory_limit()


def test_without_the_variable_it_is_a_share_of_the_machine(monkeypatch):
    monkeypatch.delenv("IRS_GYM_MEMORY")
    assert 2**26 < memory_limit() < 2**50


def test_the_refusal_says_what_it_would_take_the_limit_and_how_to_raise_it():
    check_memory("width=1: a table", 2**30, 100 * 2**30)
    message = r"^width=3: a table would take 3 GiB .* limit of 1 GiB; IRS_GYM_MEMORY sets another"
    with pytest.raises(MemoryLimitError, match=message):
        check_memory("width=3: a table", 3 * 2**30)
    with pytest.raises(
        ValueError, match=r"^width=3: a table would go over 200 GiB .* 100 times the memory limit"
    ):
        check_memory("width=3: a table", 0, 200 * 2**30)


REFUSED = [
    (
        lambda: build_radio_map("paper", 1e-3),
        r"cell_size=0\.001: the map of 20000 x 20000 cells would take",
    ),
    (lambda: build_radio_map(huge()), r"cell_size=0\.5: the map of 2000000 x 40 cells"),
    (lambda: huge().grid(0.5).centres(), r"cell_size=0\.5: the map of 2000000 x 40 cells"),
    (
        lambda: gymnasium.make(ID, cell_size=1e-3),
        r"cell_size=0\.001: map and tables of 20000 x 20000 cells",
    ),
    (
        lambda: gymnasium.make(ID, scene=huge()),
        r"cell_size=0\.5: map and tables of 2000000 x 40 cells",
    ),
    (
        lambda: gymnasium.make(ID, irs_elements=10**9),
        r"irs_elements: 50000000 phase shifts in each of 1600 cells",
    ),
    (
        lambda: build_phase_shifts(irs_elements=10**9),
        "irs_elements: phase shifts of 50000000 sub-surfaces",
    ),
    (
        lambda: build_radio_map(irs_elements=10**9, phase_bits=1),
        "irs_elements: 50000000 elements or sub-surfaces",
    ),
    (
        lambda: build_radio_map(irs_elements=10**9, array_model="spherical"),
        "irs_elements: 1000000000 elements",
    ),
    (
        lambda: build_radio_map("paper", 0.02, 10**6, 1, "optimal"),
        "irs_elements: 50000 elements or sub-surfaces",
    ),
    (lambda: gymnasium.make_vec(ID, num_envs=10**9), "num_envs=1000000000: state and observations"),
    (
        lambda: gymnasium.make_vec(ID, num_envs=10**4, max_episode_steps=10**6),
        "max_episode_steps=1000000: the paths",
    ),
    (
        lambda: gymnasium.make_vec(RANDOM, num_envs=10**9, num_scenes=1),
        "num_envs=1000000000: state and observations of 128",
    ),
    (
        lambda: build_scene_set("train", 1_000_000),
        "num_scenes=1000000: 1000000 maps of 40 x 40 cells",
    ),
    (lambda: scene_set_of([PAPER], frame=(10**6, 10**6)), r"frame=\(1000000, 1000000\): 1 maps of"),
    (
        lambda: shortest_path(np.broadcast_to(True, (10**5, 10**5)), (0, 0), (1, 1), 1.0),
        "feasible: work on a map of",
    ),
    (
        lambda: straight_line_bound(
            np.arange(10**6).reshape(1000, 1000) % 7 > 0, (0, 1), (999, 999), 1.0
        ),
        "feasible",
    ),
]


@pytest.mark.parametrize(("work", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_work_beyond_the_limit_is_refused_by_name_before_it_begins(work, message):
    with pytest.raises(MemoryLimitError, match=message):
        work()  # would take hours


def test_work_within_the_limit_is_done():
    assert build_radio_map("paper", 0.1).gain_db.shape == (200, 200)
    assert gymnasium.make(ID, cell_size=0.25).reset(seed=0)
    assert gymnasium.make_vec(ID, num_envs=512).reset(seed=0)


def test_a_higher_limit_allows_more(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "99KiB")
    with pytest.raises(
        MemoryLimitError, match=r"the map of 40 x 40 cells would take 100 KiB.*limit"
    ):
        build_radio_map("paper", irs_elements=0)
    monkeypatch.setenv("IRS_GYM_MEMORY", "20MiB")
    build_radio_map("paper", irs_elements=0)
