"""Facts about arguments: how environments refuse unknown ones, take data for objects, and are made
again from JSON.
"""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from tiny_pool import tiny_pool

import irs_gym

ID, RANDOM_ID = "irs_gym:IrsNav-v0", "irs_gym:IrsNavRandom-v0"
POOL = tiny_pool(3)
PAPER = irs_gym.load_scene("paper")
FLOOR = irs_gym.RadioMap.from_array([[0.0, -np.inf, 0.1], [0.0, 1 / 3, 0.0]], 0.25, (-1.0, 2.5))

OBJECTS = {
    "path": {"scene": Path("irs_gym/scenes/paper.json")},
    "scene": {"scene": PAPER},
    "map": {
        "radio_map": FLOOR,
        "start": (0, 0),
        "goal": np.array([1, 2]),
        "target_db": np.float32(-1.0),
    },
    "numbers": {
        "target_db": np.float64(-62.5),
        "patch_radius": np.int64(3),
        "start": [np.int64(0), 20],
    },
}


@pytest.mark.parametrize("name", OBJECTS)
def test_a_spec_with_objects_survives_json_as_data(name):
    env = gymnasium.make(ID, **OBJECTS[name])
    text = env.spec.to_json()
    json.loads(
        text, parse_constant=pytest.fail
    )  # no NaN, no Infinity: what other programs read as well
    for again in (gymnasium.make(EnvSpec.from_json(text)), gymnasium.make(env.spec)):
        assert again.spec.to_json() == text
        np.testing.assert_array_equal(
            again.unwrapped.radio_map.gain_db, env.unwrapped.radio_map.gain_db
        )
        assert again.unwrapped.radio_map.grid == env.unwrapped.radio_map.grid
        assert again.reset()[1]["oracle_distance"] == env.reset()[1]["oracle_distance"]


@pytest.mark.parametrize("name", OBJECTS)
def test_a_spec_of_a_vector_env_with_objects_survives_json_as_data(name):
    env = gymnasium.make_vec(
        ID, num_envs=2, autoreset_mode=AutoresetMode.SAME_STEP, **OBJECTS[name]
    )
    again = gymnasium.make_vec(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec.to_json() == env.spec.to_json()
    assert (again.num_envs, again.unwrapped.autoreset_mode) == (2, AutoresetMode.SAME_STEP)
    np.testing.assert_array_equal(
        again.unwrapped.radio_map.gain_db, env.unwrapped.radio_map.gain_db
    )


def test_scenes_of_a_random_env_survive_json_as_data():
    env = gymnasium.make(
        RANDOM_ID, scenes=(PAPER, PAPER.model_copy(update={"name": "again"}).to_data())
    )
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.worlds.pool.names == ("paper", "again")


def test_a_scene_is_taken_as_its_data():
    data = json.loads(Path("irs_gym/scenes/paper.json").read_text())
    env = gymnasium.make(ID, scene=data)
    assert env.unwrapped.world is gymnasium.make(ID, scene=PAPER).unwrapped.world
    assert env.unwrapped.world.scene.to_data() == {**PAPER.to_data(), **data}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"scene": {"name": 1}},
            r"scene: name: Input should be a valid string .*; room: Field required",
        ),
        ({"scene": {"name": FLOOR}}, "scene holds what JSON cannot"),
        ({"radio_map": {}}, "radio_map holds .*, not gain_db, cell_size and origin"),
        (
            {"radio_map": {**FLOOR.to_data(), "gain_db": [[0.0], [1.0, 2.0]]}},
            "radio_map: .*inhomogeneous",
        ),
        ({"radio_map": {**FLOOR.to_data(), "gain_db": 7}}, "radio_map: .*not iterable"),
        (
            {"radio_map": {**FLOOR.to_data(), "gain_db": [[float("nan")]]}},
            "radio_map: gain_db holds NaN",
        ),
    ],
)
def test_bad_data_is_refused_by_name(arguments, message):
    ends = {} if "scene" in arguments else {"start": (0, 0), "goal": (1, 2)}
    with pytest.raises(ValueError, match=message):
        gymnasium.make(ID, **arguments, **ends)


@pytest.mark.parametrize(("env_id", "more"), [(ID, {}), (RANDOM_ID, {"scenes": POOL})])
@pytest.mark.parametrize("name", ["frameskip", "from_pixels", "traget_db"])
def test_unknown_arguments_are_refused_in_the_words_that_clients_look_for(env_id, more, name):
    single, vector = (
        gymnasium.spec(env_id.removeprefix("irs_gym:")),
        gymnasium.make_vec(env_id, num_envs=2, **more),
    )
    words = rf"__init__\(\) got an unexpected keyword argument '{name}'"
    with pytest.raises(TypeError, match="IrsNav(Random)?Env." + words):
        single.make(**more, **{name: 4})
    with pytest.raises(TypeError, match=f"{type(vector.unwrapped).__name__}." + words):
        gymnasium.make_vec(env_id, num_envs=2, **more, **{name: 4})
    with pytest.raises(
        TypeError, match=words + r": the arguments are .*goal_bonus.* and render_mode"
    ):
        single.make(also_unknown=1, **more, **{name: 4})  # each is named, whatever else is wrong


@pytest.mark.parametrize(("env_id", "more"), [(ID, {}), (RANDOM_ID, {"scenes": POOL})])
@pytest.mark.parametrize("observation", ["dict", "flat", "map"])
def test_each_environment_has_spaces_of_its_own(env_id, more, observation):
    def spaces(env):
        names = (
            "observation_space",
            "action_space",
            "single_observation_space",
            "single_action_space",
        )
        return [getattr(env, name) for name in names if hasattr(env, name)]

    for make in (
        lambda: gymnasium.make(env_id, **more, observation=observation),
        lambda: gymnasium.make_vec(env_id, num_envs=2, **more, observation=observation),
    ):
        one, other = make(), make()
        for mine, theirs in zip(spaces(one), spaces(other), strict=True):
            assert mine == theirs
            assert mine is not theirs
            mine.seed(5), theirs.seed(5)
            first = mine.sample()
            mine.sample()
            assert data_equivalence(first, theirs.sample())


@pytest.mark.parametrize(("env_id", "more"), [(ID, {}), (RANDOM_ID, {"scenes": POOL})])
def test_seeds_of_every_integer_type_are_taken_and_all_else_is_refused(env_id, more):
    env = gymnasium.make(env_id, random_start=True, **more)
    expected = env.reset(seed=5)[0]["position"].tolist()
    for seed in (np.int64(5), np.uint8(5), np.array(5)):
        assert env.reset(seed=seed)[0]["position"].tolist() == expected
    for seed in (-1, np.int64(-1), 5.0, np.float64(5), True, np.bool_(True), "5"):
        with pytest.raises(ValueError, match=r"seed=.* must be an integer from 0, or None"):
            env.reset(seed=seed)

    envs = gymnasium.make_vec(env_id, num_envs=3, random_start=True, **more)
    counted = envs.reset(seed=5)[0]["position"]
    assert counted[0].tolist() == expected
    for seed in (np.int32(5), [5, 6, 7], np.array([5, 6, 7]), (5, np.int64(6), 7)):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0]["position"], counted)
    assert envs.reset(seed=[5, None, None])[0]["position"][0].tolist() == expected
    for seed in (-1, 5.0, True, [5, 6, -7], [5, True, 6], np.array([5.0, 6.0, 7.0])):
        with pytest.raises(
            ValueError, match=r"seed(\[\d\])?=.* must be an integer from 0, or None"
        ):
            envs.reset(seed=seed)
