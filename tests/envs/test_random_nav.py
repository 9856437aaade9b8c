"""Facts about the environment over many scenes: Gymnasium's contract, and that each scene is played
as it is alone.
"""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from alike import assert_same
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from tiny_pool import tiny_pool

from agents.policies.heuristics import REFERENCE_POLICIES, oracle
from agents.rollout.episode import roll_out
from irs_gym import load_scene
from irs_gym.datasets.scene_set import SceneSet, scene_set_of
from irs_gym.envs.random_nav import IrsNavRandomEnv
from irs_gym.radio.scene import Scene

ID = "irs_gym:IrsNavRandom-v0"
POOL = tiny_pool(8, (9, 7))
OBSERVATIONS = ("dict", "flat", "map")
CONSTRAINTS = ("refuse", "terminate", "allow")


def make(**kwargs) -> gymnasium.Env:
    return gymnasium.make(ID, **{"scenes": POOL, "goal_bonus": 100.0, **kwargs})


def paper(**changes) -> Scene:
    return Scene.model_validate({**load_scene("paper").model_dump(), **changes})


def small_room() -> Scene:
    """A room of 12 x 16 cells, without IRS."""
    room = {"x_min": 4.0, "x_max": 10.0, "y_min": -2.0, "y_max": 6.0, "height": 4.0}
    return paper(
        name="small",
        room=room,
        obstacles=[{"center": (7.0, 2.0), "size": (2.0, 2.0, 2.0)}],
        access_points=[{"position": (5.0, 0.0, 3.0)}],
        irs_panels=[],
        start=(4.2, 2.0),
        goal=(9.7, 2.0),
        target_db=-70.0,
    )


@pytest.fixture(scope="module")
def rooms() -> SceneSet:
    return scene_set_of([paper(target_db=-62.2, phase_bits=2), small_room()])


# --- each scene is played as it is alone ----------------------------------------------------------


@pytest.mark.parametrize(
    ("observation", "constraint"), [*zip(OBSERVATIONS, CONSTRAINTS, strict=True)]
)
def test_the_papers_scene_in_a_pool_is_that_of_the_environment_of_one_scene(
    rooms, observation, constraint
):
    both = {"observation": observation, "constraint": constraint, "goal_bonus": 100.0}
    one = gymnasium.make("irs_gym:IrsNav-v0", scene=rooms.scenes[0], irs_phases=False, **both)
    many = make(scenes=rooms, **both)
    assert many.observation_space == one.observation_space
    rng, ends = np.random.default_rng(0), 0
    for start in (None, (30, 22), (38, 20), (20, 36)):
        options = {"start": start} if start else {}
        theirs, ours = (
            one.reset(options=options),
            many.reset(options={"scene_id": "paper", **options}),
        )
        assert ours[1].pop("scene_id") == "paper"
        assert ours[1].pop("scene_number") == 0
        assert_same(ours, theirs)
        for _ in range(60):
            np.testing.assert_array_equal(
                many.unwrapped.action_masks(), one.unwrapped.action_masks()
            )
            action = int(rng.integers(8))
            theirs, ours = one.step(action), many.step(action)
            assert ours[4].pop("scene_id") == "paper"
            assert ours[4].pop("scene_number") == 0
            assert_same(ours, theirs)
            if theirs[2]:
                ends += 1
                break
    np.testing.assert_array_equal(many.unwrapped.oracle.cells, one.unwrapped.oracle.cells)
    assert ends or constraint == "refuse"


def test_a_room_smaller_than_the_frame_is_padded_with_obstacles(rooms):
    one = gymnasium.make("irs_gym:IrsNav-v0", scene=rooms.scenes[1], irs_phases=False)
    many = make(scenes=rooms, goal_bonus=10.0)
    start, info = many.reset(options={"scene_id": 1})
    alone, other = one.reset()
    assert many.unwrapped.world.feasible.shape == (40, 40)
    np.testing.assert_array_equal(start["gain_patch"], alone["gain_patch"])
    assert start["irs"].tolist() == [-1.0, -1.0, -1.0]
    cell = (np.array([0, 8]) + 0.5) / 40 * 2 - 1
    np.testing.assert_allclose(start["position"], [*cell, 11 / 40, 0 / 40], atol=1e-7)
    assert info["oracle_distance"] == other["oracle_distance"]
    many.reset(options={"scene_id": 1, "start": (11, 15)})
    after, _, _, _, info = many.step(1)  # out of the room, but not of the frame
    assert info["is_refused"]
    assert (after["gain_patch"][6:] == -1).all()
    assert (after["gain_patch"][:, 6:] == -1).all()


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_it_is_drawn_like_the_scene_alone(rooms, mode):
    one = gymnasium.make("irs_gym:IrsNav-v0", scene=rooms.scenes[0], render_mode=mode)
    many = make(scenes=rooms, render_mode=mode)
    one.reset(), many.reset(options={"scene_id": 0})
    one.step(1), many.step(1)
    picture, alone = many.render(), one.render()
    if mode == "rgb_array":  # in the middle of a white square, as rooms of a set differ in shape
        assert picture.shape[0] == picture.shape[1] == max(alone.shape[:2])
        above, left = (np.subtract(picture.shape, alone.shape) // 2)[:2]
        rows, columns = alone.shape[:2]
        inner = np.s_[above : above + rows, left : left + columns]
        np.testing.assert_array_equal(picture[inner], alone)
        picture[inner] = 255
        assert (picture == 255).all()
    else:
        assert picture == alone


# --- another scene at each reset ------------------------------------------------------------------


def test_each_reset_draws_a_scene_all_equally_likely():
    env = make()
    env.reset(seed=0)
    drawn = [env.reset()[1]["scene_id"] for _ in range(400)]
    counts = [drawn.count(name) for name in POOL.names]
    assert sum(counts) == 400
    assert counts == pytest.approx([50] * 8, abs=25)
    for _ in range(5):
        _, info = env.reset()
        assert env.step(0)[4]["scene_id"] == info["scene_id"]


def test_equal_seeds_draw_equal_scenes_and_others_others():
    def drawn(seed):
        env = make(random_start=0.5)
        observation, info = env.reset(seed=seed)
        return [
            info["scene_id"],
            *(env.reset()[1]["scene_id"] for _ in range(9)),
            observation["position"].tolist(),
        ]

    assert drawn(3) == drawn(3)
    assert len({str(drawn(seed)) for seed in range(10)}) == 10


def test_the_world_is_that_of_the_episodes_scene():
    env = make()
    for number in (3, 5):
        _, info = env.reset(options={"scene_id": number})
        world = env.unwrapped.world
        np.testing.assert_array_equal(world.feasible, POOL.feasible[number])
        assert (world.start, world.goal) == (tuple(POOL.start[number]), tuple(POOL.goal[number]))
        assert (
            info["oracle_distance"]
            == POOL.oracle_distance[number]
            == pytest.approx(env.unwrapped.oracle.distance)
        )
        assert env.unwrapped.path == [world.start]
        assert info["margin_db"] == pytest.approx(info["gain_db"] - POOL.target_db[number])


def test_a_random_start_reaches_the_goal_of_its_scene():
    env = make(random_start=True)
    starts = set()
    for seed in range(60):
        _, info = env.reset(seed=seed, options={"scene_id": 2})
        assert info["oracle_distance"] == POOL.distance_to_go[(2, *env.unwrapped.path[0])] > 0
        starts.add(env.unwrapped.path[0])
    assert len(starts) > 20


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_the_oracles_path_succeeds_in_every_scene(observation):
    env = make(observation=observation)
    policy = oracle(env)  # which reads the world of each episode anew
    for number in range(len(POOL)):
        episode = roll_out(policy, env, options={"scene_id": number})
        assert episode.is_optimal
        assert episode.oracle_distance == POOL.oracle_distance[number]


def test_every_reference_plays_in_every_scene():
    env = make(patch_radius=2)
    for name, make_policy in REFERENCE_POLICIES.items():
        policy = make_policy(env, 0)
        episodes = [roll_out(policy, env, options={"scene_id": number}) for number in range(4)]
        assert [each.oracle_distance for each in episodes] == POOL.oracle_distance[:4].tolist()
        assert name == "random" or all(each.refused == 0 for each in episodes)


def test_references_serve_a_vector_env_of_scenes_of_their_own():
    batch = gymnasium.make_vec(ID, num_envs=8, scenes=POOL)
    observation, _ = batch.reset(options={"scene_id": list(range(8))})
    single = make()
    for name in ("oracle", "greedy", "greedy_margin"):
        alone = [
            int(
                REFERENCE_POLICIES[name](single, 0).predict(
                    single.reset(options={"scene_id": n})[0]
                )[0]
            )
            for n in range(8)
        ]
        assert REFERENCE_POLICIES[name](batch, 0).predict(observation)[0].tolist() == alone


# --- where the scenes come from -------------------------------------------------------------------


def test_a_folder_of_scene_files_takes_the_place_of_a_split(tmp_path):
    for name, scene in (("b", small_room()), ("a", paper(name="small", target_db=-63.0))):
        scene.save(tmp_path / f"{name}.json")
    env = make(scenes=str(tmp_path))
    assert env.unwrapped.worlds.pool.names == ("a", "b")  # by their files' names, in their order
    assert env.reset(options={"scene_id": "b"})[1]["scene_id"] == "b"
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.worlds.pool.names == ("a", "b")
    assert again.unwrapped.worlds is env.unwrapped.worlds  # whose maps are computed once


def test_the_first_scenes_of_a_split_are_played(tmp_path, monkeypatch):
    monkeypatch.setenv("IRS_GYM_CACHE", str(tmp_path))
    env = gymnasium.make(ID, split="train", num_scenes=2)
    drawn = {env.reset(seed=seed)[1]["scene_id"] for seed in range(12)}
    assert drawn == {"train-0", "train-1"}
    assert env.unwrapped.world.feasible.shape == (40, 40)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"scenes": None, "split": "exam"}, "split='exam' must be one of"),
        ({"scenes": None, "num_scenes": 0}, "num_scenes=0 must be a number from 1"),
        (
            {"scenes": None, "split": "val", "num_scenes": 1001},
            "num_scenes=1001 must be a number from 1 to 1000",
        ),
        ({"split": "val"}, "split cannot be given along with scenes"),
        ({"num_scenes": 10}, "num_scenes cannot be given along with scenes"),
        ({"scenes": ()}, "scenes is empty"),
        (
            {"scenes": (paper(), "paper")},
            "must be a folder of scene files, a sequence of scenes, or a pool",
        ),
        ({"scenes": (paper(target_db=-50.0),)}, "scene 'paper': target_db=-50.0 is infeasible"),
        ({"observation": "picture"}, "observation='picture' must be one of"),
        ({"patch_radius": -1}, "patch_radius=-1 must be"),
        ({"random_start": 2}, "random_start=2 must be"),
        (
            {"constraint": "terminate", "goal_bonus": 0.0},
            "scene 'tiny-.': goal_bonus=0.0 is too small",
        ),
        ({"render_mode": "video"}, "render_mode='video' must be one of"),
    ],
)
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_bad_arguments_are_refused_by_name(kwargs, message, kind):
    with pytest.raises(ValueError, match=message):
        make(**kwargs) if kind == "single" else gymnasium.make_vec(
            ID, num_envs=2, **{"scenes": POOL, **kwargs}
        )


def test_unknown_arguments_and_folders_are_refused_by_name(tmp_path):
    with pytest.raises(
        TypeError,
        match="got an unexpected keyword argument 'target_db': the arguments are split, num_scenes, scenes",
    ):
        make(target_db=-61.8)
    with pytest.raises(FileNotFoundError, match="is no folder of scene files"):
        make(scenes=tmp_path / "nowhere")
    with pytest.raises(ValueError, match="holds no scene file"):
        make(scenes=tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scene": 1}, "unknown key scene: it may hold start and goal, cells .i, j., and scene_id"),
        (
            {"scene_id": "paper"},
            r"scene_id='paper' must be a name of a scene \('tiny-0'.* from 0 to 7",
        ),
        ({"scene_id": 8}, "scene_id=8 must be a name"),
        ({"scene_id": -1}, "scene_id=-1 must be a name"),
        ({"scene_id": 1.0}, "scene_id=1.0 must be a name"),
        ({"scene_id": 0, "start": (9, 0)}, "lies off the map"),
        ({"start": 7}, "start=7 must be a cell"),
    ],
)
def test_bad_options_are_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        make().reset(options=options)


def test_a_name_of_several_scenes_is_refused():
    pool = SceneSet(
        **{
            **{name: getattr(POOL, name) for name in POOL.__dataclass_fields__},
            "names": ("same",) * 8,
        }
    )
    with pytest.raises(ValueError, match="'same' is the name of 8 scenes: give a number"):
        make(scenes=pool).reset(options={"scene_id": "same"})


# --- Gymnasium's contract -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("observation", "constraint"), [*zip(OBSERVATIONS, CONSTRAINTS, strict=True)]
)
@pytest.mark.filterwarnings("error")
def test_gymnasiums_and_stable_baselines_checkers_find_nothing(observation, constraint):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = make(observation=observation, constraint=constraint)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*gain_patch.*|.*unconventional shape.*")
        warnings.filterwarnings(
            "ignore", message="It seems that your observation (space )? is an image"
        )
        warnings.filterwarnings("ignore", message="The minimal resolution for an image")
        # says so of every made environment, whose wrappers it is right to avoid
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version.*")
        check_env(env.unwrapped, skip_render_check=True)
        check_env(env, skip_render_check=True)
        checker.check_env(env, skip_render_check=True)


def test_copies_go_on_alike():
    env = make(random_start=0.5)
    env.reset(seed=1)
    env.step(0)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        original = copy.deepcopy(env)
        for episode in range(5):
            assert data_equivalence(original.step(episode), twin.step(episode))
            assert data_equivalence(original.reset(), twin.reset())
    assert copy.deepcopy(env).unwrapped.worlds.pool is POOL


def test_flat_is_dict_flattened():
    as_dict, flat = make(), gymnasium.make("irs_gym:IrsNavRandomFlat-v0", scenes=POOL)
    for seed in range(10):
        one, other = as_dict.reset(seed=seed)[0], flat.reset(seed=seed)[0]
        np.testing.assert_array_equal(
            gymnasium.spaces.flatten(as_dict.observation_space, one), other
        )


def test_stepping_needs_an_episode():
    env = IrsNavRandomEnv(scenes=POOL)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(0)
