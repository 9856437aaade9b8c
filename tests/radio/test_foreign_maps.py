"""Facts of environments on maps from elsewhere: measured, or traced by another program."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from irs_gym import RadioMap, build_radio_map, shortest_path
from irs_gym.radio.scene import load_scene

ID = "irs_gym:IrsNav-v0"
START, GOAL = (0, 1), (11, 8)


@pytest.fixture
def measured() -> RadioMap:
    """12 x 10 cells of 0.4 m: whole decibels with noise, an obstacle, and a corner far from zero."""
    rng = np.random.default_rng(5)
    gain_db = -60.0 - rng.integers(0, 12, (12, 10))
    gain_db[4:7, 0:7] = -np.inf
    gain_db[START] = gain_db[GOAL] = -50.0
    return RadioMap.from_array(gain_db, cell_size=0.4, origin=(103.0, -7.5))


@pytest.fixture
def path(measured, tmp_path) -> str:
    measured.save(tmp_path / "measured.npz")
    return str(tmp_path / "measured.npz")


def follow(env, cells) -> float:
    """Walk along cells; the metres that the environment says were travelled. Ends at the goal, or
    fails.
    """
    _, info = env.reset(seed=0)
    ways = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    is_terminated = False
    for step in np.diff(cells, axis=0).tolist():
        assert not is_terminated
        _, _, is_terminated, _, info = env.step(ways.index(tuple(step)))
    assert is_terminated
    assert info["is_success"]
    assert info["spl"] == pytest.approx(1.0, rel=1e-12)
    return info["distance"]


@pytest.mark.parametrize("as_object", [False, True])
def test_a_measured_map_serves_in_place_of_the_closed_form(measured, path, as_object):
    env = gymnasium.make(
        ID, radio_map=measured if as_object else path, start=START, goal=GOAL, target_db=-69.0
    )
    world = env.unwrapped
    np.testing.assert_array_equal(world.radio_map.gain_db, measured.gain_db)
    assert world.radio_map.grid == measured.grid
    expected = shortest_path(measured.gain_db >= -69.0, START, GOAL, 0.4)
    _, info = env.reset(seed=0)
    assert info["oracle_distance"] == pytest.approx(expected.distance, abs=1e-12)
    assert info["gain_db"] == -50.0
    assert world.oracle.distance == pytest.approx(expected.distance, abs=1e-12)
    assert follow(env, expected.cells) == pytest.approx(expected.distance, abs=1e-12)


def test_the_papers_own_map_from_a_file_is_the_same_task_as_the_scene(tmp_path):
    scene, radio_map = load_scene("paper"), build_radio_map("paper")
    radio_map.save(tmp_path / "paper.npz")
    ends = {name: radio_map.grid.cell_of(getattr(scene, name)) for name in ("start", "goal")}
    own = gymnasium.make(ID, irs_phases=False)
    foreign = gymnasium.make(ID, radio_map=str(tmp_path / "paper.npz"), irs_phases=False, **ends)
    seen, also_seen = own.reset(seed=0)[0], foreign.reset(seed=0)[0]
    for key in ("position", "gain_patch"):
        np.testing.assert_array_equal(seen[key], also_seen[key])
    for action in [0, 1, 2, 7, 0, 4, 6, 5, 3, 1] * 5:
        (_, *outcome, info), (_, *also_outcome, also_info) = own.step(action), foreign.step(action)
        assert outcome == also_outcome
        for key in ("distance", "distance_to_go", "gain_db", "refused"):
            assert info[key] == also_info[key]


@pytest.mark.parametrize("observation", ["dict", "flat", "map"])
@pytest.mark.parametrize("constraint", ["refuse", "allow"])
def test_gymnasiums_checker_finds_nothing_on_a_map_from_a_file(path, observation, constraint):
    arguments = {"radio_map": path, "start": START, "goal": GOAL, "target_db": -69.0}
    env = gymnasium.make(ID, observation=observation, constraint=constraint, **arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_the_observation_says_that_no_irs_is_known(path):
    env = gymnasium.make(ID, radio_map=path, start=START, goal=GOAL, target_db=-69.0)
    assert env.reset(seed=0)[0]["irs"].tolist() == [-1.0, -1.0, -1.0]


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_it_is_drawn_without_a_scene(path, mode):
    env = gymnasium.make(
        ID, radio_map=path, start=START, goal=GOAL, target_db=-69.0, render_mode=mode
    )
    env.reset(seed=0)
    picture = env.render()
    assert len(picture) > 20
    if mode == "rgb_array":
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_the_spec_survives_json(path):
    env = gymnasium.make(ID, radio_map=path, start=START, goal=GOAL, target_db=-69.0)
    spec = type(env.spec).from_json(env.spec.to_json())
    again = gymnasium.make(spec)
    assert again.unwrapped.oracle.distance == env.unwrapped.oracle.distance


def test_the_vector_env_takes_it_too(path, measured):
    envs = gymnasium.make_vec(
        ID, num_envs=3, radio_map=path, start=START, goal=GOAL, target_db=-69.0
    )
    _, info = envs.reset(seed=0)
    expected = shortest_path(measured.feasible(-69.0), START, GOAL, 0.4).distance
    np.testing.assert_allclose(info["oracle_distance"], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": None}, "start must be given as a cell"),
        ({"goal": None}, "goal must be given as a cell"),
        ({"start": (5, 3)}, r"start=\(5, 3\) lies in an obstacle"),
        ({"goal": (12, 0)}, r"goal=\(12, 0\) lies off the map of \(12, 10\) cells"),
        ({"target_db": -51.0}, r"target_db=-51\.0 is infeasible.*the highest feasible target is"),
        ({"phase_bits": 1}, "phase_bits cannot be given along with radio_map"),
        ({"scene": "paper", "cell_size": 0.4}, "cell_size cannot be given along with radio_map"),
    ],
)
def test_what_does_not_go_with_a_map_is_refused_by_name(path, change, message):
    arguments = {"radio_map": path, "start": START, "goal": GOAL, "target_db": -69.0} | change
    with pytest.raises(ValueError, match=message):
        gymnasium.make(ID, **arguments)


def test_a_file_that_is_missing_or_no_map_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.npz"):
        gymnasium.make(ID, radio_map=str(tmp_path / "nowhere.npz"), start=START, goal=GOAL)
    (tmp_path / "text.npz").write_text("gain_db")
    with pytest.raises(ValueError, match=r"text\.npz' is not a radio map"):
        gymnasium.make(ID, radio_map=str(tmp_path / "text.npz"), start=START, goal=GOAL)
