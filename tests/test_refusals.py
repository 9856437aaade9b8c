"""Facts of what comes from users: whatever can mean nothing is a ``ValueError`` that names the
field.
"""

import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import irs_gym
from irs_gym import (
    Difficulty,
    Grid,
    RadioMap,
    build_phase_shifts,
    build_radio_map,
    distance_to_go,
    generate_scene,
    highest_feasible_target,
    load_scene,
    shortest_path,
    straight_line_bound,
    trade_off,
)
from irs_gym.datasets.scene_set import scene_set_of
from irs_gym.envs.nav import IrsNavEnv
from irs_gym.envs.random_nav import IrsNavRandomEnv
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from irs_gym.envs.vector_nav import IrsNavVectorEnv
from irs_gym.radio.scene import Scene

PAPER = load_scene("paper")
GAIN = build_radio_map("paper", 1.0).gain_db
FEASIBLE = np.isfinite(GAIN)
ENDS = ((0, 10), (19, 10))
INF, NAN = float("inf"), float("nan")


def changed(**parts) -> Scene:
    """The paper's scene with other parts, checked anew."""
    return Scene.model_validate({**PAPER.model_dump(), **parts})


# --- arrays ---------------------------------------------------------------------------------------

NO_CELLS = [
    (0.5, 20),
    (True, False),
    (np.True_, 0),
    ("0", "1"),
    "ab",
    (0,),
    (0, 1, 2),
    None,
    3,
    (NAN, 0),
    np.zeros(2),
]


@pytest.mark.parametrize("name", ["start", "goal"])
@pytest.mark.parametrize("cell", NO_CELLS, ids=repr)
def test_a_cell_is_two_integers(name, cell):
    ends = {"start": ENDS[0], "goal": ENDS[1], name: cell}
    for function in (shortest_path, straight_line_bound):
        with pytest.raises(
            ValueError, match=rf"^{name}=.* must be a cell \(i, j\) of two integers"
        ):
            function(FEASIBLE, *ends.values(), 1.0)
    with pytest.raises(ValueError, match=rf"^{name}=.* must be a cell"):
        trade_off(GAIN, *ends.values(), 1.0)
    with pytest.raises(ValueError, match=rf"^{name}=.* must be a cell"):
        highest_feasible_target(GAIN, *ends.values())
    if cell is not None:
        with pytest.raises(ValueError, match=rf"^{name}=.* must be a cell"):
            IrsNavEnv(cell_size=1.0, **{name: cell})
    if name == "goal":
        with pytest.raises(ValueError, match=r"^goal=.* must be a cell"):
            distance_to_go(FEASIBLE, cell, 1.0)


@pytest.mark.parametrize(
    "cell_size", [-1, 0, NAN, INF, True, "0.5", None, 1j, 1e-320, 1e300, [0.5]]
)
def test_a_cell_has_a_size(cell_size):
    works = [
        lambda: shortest_path(FEASIBLE, *ENDS, cell_size),
        lambda: straight_line_bound(FEASIBLE, *ENDS, cell_size),
        lambda: distance_to_go(FEASIBLE, ENDS[1], cell_size),
        lambda: trade_off(GAIN, *ENDS, cell_size),
        lambda: RadioMap.from_array(GAIN, cell_size),
        lambda: Grid((3, 3), cell_size, (0.0, 0.0)),
        lambda: Grid.tile((0.0, 0.0), (3.0, 3.0), cell_size),
        lambda: build_radio_map("paper", cell_size),
        lambda: build_phase_shifts("paper", cell_size),
        lambda: IrsNavEnv(cell_size=cell_size),
        lambda: scene_set_of([PAPER], cell_size=cell_size),
    ]
    for work in works:
        with pytest.raises(
            ValueError, match=r"cell_size=.* must (be a positive number of metres|lie from)"
        ):
            work()


@pytest.mark.parametrize("value", [NAN, INF])
def test_a_map_with_nan_or_infinite_gains_is_refused(value):
    gain = GAIN.copy()
    gain[3, 3] = value
    for function in (highest_feasible_target, lambda *them: trade_off(*them, 1.0)):
        with pytest.raises(ValueError, match=r"gain_db holds NaN or \+inf"):
            function(gain, *ENDS)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros(4), r"shape \(4,\)"),
        (np.zeros((0, 3)), r"shape \(0, 3\)"),
        (np.zeros((2, 2), complex), "complex128"),
        (np.zeros((2, 2), "U3"), "<U3"),
        (np.array([[None, 1.0]]), "object"),
        ([[1.0], [1.0, 2.0]], "gain_db is no array"),
        (None, "object"),
    ],
)
def test_gains_are_a_map_of_real_numbers(array, message):
    for function in (highest_feasible_target, lambda *them: trade_off(*them, 1.0)):
        with pytest.raises(ValueError, match=message):
            function(array, (0, 0), (0, 1))


@pytest.mark.parametrize(
    "array", [np.ones((3, 3)), np.ones((3, 3), int), np.ones(3, bool), GAIN, [["a"]], None]
)
def test_feasible_cells_are_a_map_of_bools(array):
    for function in (shortest_path, straight_line_bound):
        with pytest.raises(ValueError, match=r"feasible (has|holds)"):
            function(array, (0, 0), (1, 1), 1.0)
    with pytest.raises(ValueError, match=r"feasible (has|holds)"):
        distance_to_go(array, (0, 0), 1.0)


def test_lists_and_whole_numbers_serve_as_maps():
    assert highest_feasible_target([[1, 3, 2]], (0, 0), (0, 2)) == 1.0
    assert highest_feasible_target(np.array([[1, 3, 2]], np.uint8), (0, 0), (0, 2)) == 1.0
    assert (
        shortest_path([[True, True]], np.array([0, 0]), (np.int8(0), 1), np.float32(0.5)).distance
        == 0.5
    )
    assert trade_off([[1, 3, 2]], (0, 0), (0, 2), 2).distances.tolist() == [4.0]


@pytest.mark.parametrize("target_db", [NAN, "a", None, [0.0, NAN]])
def test_a_target_of_the_trade_off_is_a_number(target_db):
    with pytest.raises(ValueError, match=r"target_db=.* must be numbers of dB"):
        trade_off(GAIN, *ENDS, 1.0).distance_at(target_db)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 3), 1.0, (0, 0)), "shape="),
        (((-3, 3), 1.0, (0, 0)), "shape="),
        (((2.0, 3), 1.0, (0, 0)), "shape="),
        ((5, 1.0, (0, 0)), "shape="),
        (((2, 3), 1.0, (0, "0")), "origin="),
        (((2, 3), 1.0, (0, 1e300)), "origin="),
        (((2, 3), 1.0, None), "origin="),
    ],
)
def test_a_grid_that_no_floor_has_is_refused(arguments, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Grid(*arguments)


@pytest.mark.parametrize("point", [("0", 1), (True, 1), (1,), None, (1, 2, 3), 4])
def test_a_point_is_two_numbers(point):
    with pytest.raises(ValueError, match=r"^point=.* must be two finite numbers"):
        Grid((4, 4), 1.0, (0.0, 0.0)).cell_of(point)
    with pytest.raises(ValueError, match=r"^lower=.* must be two finite numbers"):
        Grid.tile(point, (4.0, 4.0), 1.0)


# --- scenes ---------------------------------------------------------------------------------------


def coefficients(**more) -> dict:
    """The paper's path loss with other coefficients, with and without line of sight."""
    data = PAPER.path_loss.model_dump()
    return {"path_loss": {name: {**part, **more} for name, part in data.items()}}


SCENES = [
    ({"carrier_ghz": 1e-320}, "carrier_ghz"),
    ({"carrier_ghz": 1e300}, "carrier_ghz"),
    ({"antenna_height": 1e300}, "antenna_height"),
    ({"rician_factor_db": 1e5}, "rician_factor_db"),
    ({"start": (1e300, 0)}, r"start\.0"),
    (
        {"irs_panels": [{**PAPER.irs_panels[0].model_dump(), "pitch_wavelengths": 1e308}]},
        "pitch_wavelengths",
    ),
    (
        {"irs_panels": [{**PAPER.irs_panels[0].model_dump(), "pitch_wavelengths": 1e-320}]},
        "pitch_wavelengths",
    ),
    ({"irs_panels": [{**PAPER.irs_panels[0].model_dump(), "columns": 10**30}]}, "columns"),
    (
        {"irs_panels": [{**PAPER.irs_panels[0].model_dump(), "columns": 10**9, "rows": 10**9}]},
        "make 20000000000000000000 elements",
    ),
    (coefficients(intercept_db=1e308), "intercept_db"),
    (coefficients(distance_slope_db=-1e9), "distance_slope_db"),
    (coefficients(intercept_db=-900.0), r"irs_panels\[0\].position=.* path_loss there is -8.* dB"),
    (
        {"access_points": [{"position": (0, -10 + 1e-12, 2)}]},
        r"irs_panels\[0\].position=.* coincides",
    ),
    (
        {"access_points": [{"position": (0, -10 + 1e-6, 2)}]},
        r"irs_panels\[0\].position=.* is 1e-06 m from an access",
    ),
    ({"obstacles": [PAPER.obstacles[0].model_dump()] * 10_001}, "obstacles"),
]


@pytest.mark.parametrize(("parts", "message"), SCENES, ids=[message for _, message in SCENES])
def test_what_no_factory_has_is_refused_by_name(parts, message):
    with pytest.raises(ValueError, match=message):
        changed(**parts)


def test_a_gain_that_underflows_is_said_and_not_shown_as_an_obstacle():
    absurd = coefficients(intercept_db=1000.0, distance_slope_db=1000.0, frequency_slope_db=1000.0)
    scene = changed(**absurd, irs_panels=[], carrier_ghz=1e6)
    with pytest.raises(
        ValueError, match=r"the expected gain in the free cell \(0, 0\) underflows to 0: path_loss"
    ):
        build_radio_map(scene, 1.0)


def test_an_antenna_so_near_that_path_loss_were_a_gain_is_refused():
    near = changed(access_points=[{"position": (1.5, 9.5, 1 + 1e-9)}])
    with pytest.raises(
        ValueError, match=r"path_loss is -1.* dB at 1e-09 m from an antenna at \(1.5, 9.5,"
    ):
        build_radio_map(near, 1.0)


def test_a_file_of_many_mistakes_is_told_in_a_line_of_bounded_length(tmp_path):
    boxes = ",".join(['{"center": "' + "x" * 5000 + '"}'] * 500)
    text = PAPER.model_dump_json().replace('"obstacles":[', f'"obstacles":[{boxes},')
    (tmp_path / "scene.json").write_text(text)
    with pytest.raises(
        ValueError, match=r"obstacles\[0\]\.center.*and \d+ more mistakes$"
    ) as raised:
        load_scene(tmp_path / "scene.json")
    assert len(str(raised.value)) < 5000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sides": (NAN, 5)}, "sides="),
        ({"sides": ("a", "b")}, "sides="),
        ({"sides": (4.0, 1e6)}, "sides="),
        ({"boxes": (0, 10**9)}, "boxes="),
        ({"boxes": (0.5, 2)}, "boxes="),
        ({"panels": ([],)}, "panels="),
        ({"panels": "usual"}, "panels="),
        ({"detour": "1.1"}, "detour="),
        ({"detour_share": NAN}, "detour_share="),
    ],
)
def test_a_difficulty_out_of_range_is_refused(arguments, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Difficulty(**arguments)


def test_scenes_are_drawn_by_a_generator_at_a_difficulty():
    with pytest.raises(ValueError, match=r"rng=5 must be a numpy\.random\.Generator"):
        generate_scene(5)
    with pytest.raises(ValueError, match=r"difficulty=5"):
        generate_scene(np.random.default_rng(0), 5)


def test_a_difficulty_that_no_factory_meets_ends(monkeypatch):
    monkeypatch.setattr("irs_gym.datasets.generator.FACTORIES", 3)
    with pytest.raises(ValueError, match=r"difficulty=.* none of 3 factories"):
        generate_scene(
            np.random.default_rng(0),
            Difficulty(sides=(4.0, 4.0), boxes=(0, 0), detour=1.5, detour_share=1.0),
        )


# --- environments ---------------------------------------------------------------------------------

ARGUMENTS = [
    *(("target_db", value) for value in (NAN, INF, "a", True, 1e300, 10**400)),
    *(("goal_bonus", value) for value in (NAN, -1, "a", True, None, 10**400)),
    *(("patch_radius", value) for value in (-1, 101, 1.5, True, "1")),
    *(("irs_elements", value) for value in (-200, 1.0, True, "1200", [1200], 10**30)),
    *(("phase_bits", value) for value in (0, 17, 1.0, True, [1])),
    *(
        (name, value)
        for name in ("observation", "constraint", "quantiser")
        for value in ("x", None, [], 0)
    ),
    *((name, value) for name in ("irs_phases", "shaping") for value in ("True", 1, None, 0.5)),
    *(("robot_radius", value) for value in (-0.1, NAN, INF, True, "1", None)),
    *((name, value) for name in ("corner_cutting", "collision") for value in ("x", 1, None, [])),
    *(("random_start", value) for value in (-0.1, 1.1, NAN, "a", None)),
    *(("render_mode", value) for value in ("video", 1, [], True)),
]


@pytest.mark.parametrize(("name", "value"), ARGUMENTS, ids=str)
def test_an_argument_out_of_its_range_is_refused_by_name(name, value):
    for kind in (IrsNavEnv, IrsNavVectorEnv):
        with pytest.raises(ValueError, match=rf"{name}="):
            kind(cell_size=2.0, **{name: value})


@pytest.mark.parametrize("kind", [IrsNavRandomEnv, IrsNavRandomVectorEnv])
@pytest.mark.parametrize(
    "arguments",
    [{"split": []}, {"split": 3}, {"num_scenes": []}, {"num_scenes": True}, {"scenes": 3}],
)
def test_scenes_to_draw_from_are_named_where_there_are_none(kind, arguments):
    (name,) = arguments
    with pytest.raises(ValueError, match=f"{name}="):
        kind(**arguments)


@pytest.mark.parametrize("name", ["num_envs", "max_episode_steps"])
@pytest.mark.parametrize("value", [0, -1, 1.5, True, "4", None])
def test_counts_of_a_vector_environment_are_positive_integers(name, value):
    with pytest.raises(ValueError, match=f"{name}={value!r} must be a positive integer"):
        IrsNavVectorEnv(**{name: value})


def test_nothing_is_checked_by_asserts():
    """Python leaves them out with ``-O``: what is refused here is refused there."""
    program = """
import irs_gym, numpy as np
from irs_gym.datasets.random_task import RandomTask
from irs_gym.envs.nav import IrsNavEnv
cell = np.zeros((3, 3), bool)
for work in (
    lambda: RandomTask(constraint="x"),
    lambda: RandomTask(random_start=2),
    lambda: IrsNavEnv(start=(0.5, 20)),
    lambda: IrsNavEnv(radio_map=5, start=(0, 0), goal=(1, 1)),
    lambda: irs_gym.shortest_path(cell, (0, 0), (9, 9), 1.0),
    lambda: irs_gym.RadioMap.from_array([[float("nan")]], 1.0),
    lambda: irs_gym.Grid((0, 1), 1.0, (0, 0)),
):
    try:
        work()
    except ValueError:
        continue
    raise SystemExit("taken")
"""
    subprocess.run([sys.executable, "-O", "-c", program], check=True, cwd=Path(__file__).parents[1])


# --- what is shared -------------------------------------------------------------------------------


def arrays_of(thing, seen) -> list[np.ndarray]:
    """All arrays that an object of this package holds on to."""
    if id(thing) in seen:
        return []
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return [thing]
    if isinstance(thing, tuple | list):
        return [each for part in thing for each in arrays_of(part, seen)]
    if type(thing).__module__.startswith("irs_gym") and hasattr(thing, "__dict__"):
        return [each for part in vars(thing).values() for each in arrays_of(part, seen)]
    return []


def test_arrays_that_environments_share_are_read_only():
    env = gymnasium.make("irs_gym:IrsNav-v0", cell_size=1.0)
    env.reset(seed=0)
    envs = IrsNavVectorEnv(2, cell_size=1.0)
    random = IrsNavRandomVectorEnv(2, num_scenes=2, split="val")
    random.reset(seed=0)
    base = env.unwrapped
    shared = [
        base.world,
        base._episode.tables,
        base.oracle,
        base.radio_map,
        envs.world,
        random.worlds,
    ]
    shared += [each._episodes._sampler.transition_model for each in (envs, random)]
    found = arrays_of(shared, set())
    assert len(found) >= 35
    assert not any(each.flags.writeable for each in found)


# --- cells without a signal -----------------------------------------------------------------------


def silent() -> RadioMap:
    """A corridor of 5 cells of which the middle one is free and receives nothing, between two
    walls.
    """
    gain_db = np.full((5, 3), -np.inf)
    gain_db[:, 1] = [-60, -61, -np.inf, -61, -60]
    free = np.zeros((5, 3), bool)
    free[:, 1] = True
    return RadioMap.from_array(gain_db, 1.0, free=free)


def test_a_free_cell_that_receives_nothing_can_be_crossed_at_a_cost():
    assert silent().free[2, 1]
    assert not silent().feasible(-200.0)[2, 1]
    ends = {"radio_map": silent(), "start": (0, 1), "goal": (1, 1), "target_db": -70.0}
    env = IrsNavEnv(**ends, constraint="allow", render_mode="ansi")
    env.reset(seed=0)
    env.reset(options={"start": (1, 1), "goal": (0, 1)})
    _, _, _, _, info = env.step(0)
    assert (info["is_refused"], info["cost"], info["gain_db"]) == (False, 1.0, -np.inf)
    refusing = IrsNavEnv(**ends)
    refusing.reset(options={"start": (1, 1), "goal": (0, 1)})
    assert refusing.step(0)[-1]["is_refused"]
    with pytest.raises(ValueError, match="no target is"):
        IrsNavEnv(**ends | {"goal": (4, 1)})


def test_it_is_drawn_as_below_the_target_and_not_as_an_obstacle():
    env = IrsNavEnv(
        radio_map=silent(), start=(0, 1), goal=(1, 1), target_db=-70.0, render_mode="ansi"
    )
    env.reset(seed=0)
    row = next(line for line in env.render().splitlines() if "~" in line)
    assert row.count("~") == 1
    picture = IrsNavEnv(
        radio_map=silent(), start=(0, 1), goal=(1, 1), target_db=-70.0, render_mode="rgb_array"
    )
    picture.reset(seed=0)
    assert picture.render().dtype == np.uint8


def test_free_cells_survive_the_file_and_change_no_file_without_them(tmp_path):
    silent().save(tmp_path / "silent.npz")
    again = RadioMap.load(tmp_path / "silent.npz")
    np.testing.assert_array_equal(again.free, silent().free)
    assert again.gain_db.tobytes() == silent().gain_db.tobytes()
    build_radio_map("paper", 1.0).save(tmp_path / "paper.npz")
    with np.load(tmp_path / "paper.npz") as file:
        assert sorted(file.files) == ["cell_size", "format_version", "gain_db", "origin"]


def test_a_cell_that_is_not_free_receives_nothing():
    radio_map = RadioMap.from_array([[-60.0, -61.0]], 1.0, free=[[True, False]])
    assert radio_map.gain_db.tolist() == [[-60.0, -np.inf]]
    for free in ([[True]], [[1, 0]], "free"):
        with pytest.raises(ValueError, match="free h"):
            RadioMap.from_array([[-60.0, -61.0]], 1.0, free=free)


def test_a_map_that_tells_free_cells_is_another_problem():
    from agents.runs.problem import problem_of
    from irs_gym.mdp.task import Task

    bare = RadioMap(silent().gain_db, grid=silent().grid)
    ends = {"start": (0, 1), "goal": (1, 1)}
    told, untold = (problem_of(Task(radio_map=each, **ends)).radio_map for each in (silent(), bare))
    assert told != untold


def test_the_public_names_are_all_tried_here():
    source = Path(__file__).read_text() + Path(__file__).with_name("test_archives.py").read_text()
    untried = {
        "FloorPlan",
        "MovingAiScenario",
        "BudgetToGo",
        "Front",
        "Path",
        "Robot",
        "read_geojson",
        "read_movingai_map",
        "read_movingai_scenarios",
        "read_picture",
        "read_ros_map",
        "shortest_lengths",
        "Scene",
        "SixTuple",
        "TradeOff",
        "VectorReward",
        "__version__",
        "budget_to_go",
        "cost_map",
        "from_rssi_histograms",
        "from_sionna",
        "outage_probability",
        "pareto_front",
        "JointPath",
        "SwitchFront",
        "FewestConfigurations",
        "Codebook",
        "codebook_gain_db",
        "dft_codebook",
        "focused_codebook",
        "cover_codebook",
        "fewest_configurations",
        "joint_shortest_path",
        "joint_distance_to_go",
        "highest_joint_target",
        "switch_front",
        "Bounds",
        "EuclideanToGo",
        "Polyline",
        "certified_bounds",
        "euclidean_distance_to_go",
        "straight_line_path",
        "BeliefNode",
        "BeliefOptimum",
        "belief_optimum",
    }  # results, data; tests of their own
    assert all(name in source for name in {*irs_gym.__all__} - untried)
