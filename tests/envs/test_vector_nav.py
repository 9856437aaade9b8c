"""Facts about the vector environment, most of them against Gymnasium's own over single
environments.
"""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, assert_same, both
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from irs_gym.envs.vector_nav import IrsNavVectorEnv

SCENES = Path(__file__).resolve().parents[2] / "irs_gym" / "scenes"
ID = "irs_gym:IrsNav-v0"
# close ends and a short limit: many episodes of every kind in few steps
OFTEN = {
    "target_db": -62.2,
    "patch_radius": 2,
    "start": (30, 22),
    "goal": (33, 20),
    "max_episode_steps": 30,
}


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize("observation", ["dict", "flat", "map"])
def test_vector_env_equals_n_single_envs(constraint, observation, mode):
    ours, single = both(
        ID,
        5,
        mode,
        constraint=constraint,
        observation=observation,
        random_start=0.5,
        goal_bonus=30.0,
        infos="all",
        **OFTEN,
    )
    assert assert_equal_for(10_000 // 5, ours, single) > 300


def test_make_vec_warns_of_nothing_and_truncates_as_told(recwarn):
    env = gymnasium.make_vec(ID, num_envs=3, max_episode_steps=4)
    assert not recwarn.list
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    flags = [env.step(np.full(3, 4))[3].tolist() for _ in range(9)]
    assert flags == [[n % 5 == 3] * 3 for n in range(9)]
    assert gymnasium.make_vec(ID, num_envs=3).unwrapped.max_episode_steps == 400


def test_next_step_autoreset_ignores_the_action_and_pays_nothing():
    env = gymnasium.make_vec(ID, num_envs=2, start=(38, 20))
    env.reset()
    _, _, terminated, _, infos = env.step(np.array([0, 4]))
    assert terminated.tolist() == [True, False]
    assert infos["is_success"].tolist() == [True, False]
    assert env.paths()[0] == [(38, 20), (39, 20)]
    obs, reward, terminated, truncated, infos = env.step(np.array([4, 4]))
    assert (reward[0], terminated[0], truncated[0]) == (0.0, False, False)
    assert env.paths() == [[(38, 20)], [(38, 20), (37, 20), (36, 20)]]
    np.testing.assert_array_equal(obs["position"][0], env.reset()[0]["position"][0])


def test_the_first_environments_infos_outlive_the_next_steps():
    arguments = {"random_start": True, "target_db": -62.5, "infos": "all"}
    env = gymnasium.make_vec(ID, num_envs=4, autoreset_mode="SameStep", **arguments)
    env.reset(seed=0)
    rng, kept, seen = np.random.default_rng(0), [], []
    for _ in range(300):
        infos = env.step(rng.integers(0, 8, 4))[4]
        kept.append(infos)
        seen.append(
            {
                key: np.copy(infos[key])
                for key in ("distance", "refused", "spl", "is_success", "gain_db")
            }
        )
        if len(kept) > 5:  # looked at late, when episodes have begun anew
            late, early = kept[-5], seen[-5]
            assert late["margin_db"].tolist() == (early["gain_db"] + 62.5).tolist()
            assert_same({key: late[key] for key in early}, early)


@pytest.mark.parametrize("copy", [True, False])
def test_observations_have_memory_of_their_own_unless_told_otherwise(copy):
    env = gymnasium.make_vec(ID, num_envs=2, copy=copy)
    first, _ = env.reset(seed=0)
    second = env.step(np.array([0, 1]))[0]
    assert np.shares_memory(first["irs"], second["irs"]) == (not copy)
    assert (first["position"] == second["position"]).all() == (not copy)


def test_seeds_are_counted_up_or_given_one_by_one():
    env = gymnasium.make_vec(ID, num_envs=3, random_start=True)
    counted = env.reset(seed=5)[0]["position"]
    np.testing.assert_array_equal(counted, env.reset(seed=[5, 6, 7])[0]["position"])
    single = gymnasium.make(ID, random_start=True)
    np.testing.assert_array_equal(counted[2], single.reset(seed=7)[0]["position"])
    assert not np.array_equal(counted, env.reset(seed=6)[0]["position"])
    with pytest.raises(ValueError, match="seed holds 2 numbers for 3 environments"):
        env.reset(seed=[1, 2])


def test_a_reset_mask_leaves_the_others_alone():
    env = gymnasium.make_vec(ID, num_envs=4, autoreset_mode="Disabled", max_episode_steps=3)
    with pytest.raises(ResetNeeded, match="the first reset must be of all"):
        env.reset(options={"reset_mask": np.array([True, False, False, False])})
    env.reset(seed=0)
    for _ in range(2):
        before = env.step(np.zeros(4, dtype=int))[0]
    mask = np.array([True, False, True, False])
    after, infos = env.reset(options={"reset_mask": mask})
    assert infos["_oracle_distance"].tolist() == mask.tolist()
    np.testing.assert_array_equal(after["position"][~mask], before["position"][~mask])
    assert (after["position"][mask] != before["position"][mask]).any()
    truncated, infos = env.step(np.zeros(4, dtype=int))[3:]
    assert truncated.tolist() == (~mask).tolist()
    assert [len(path) for path in env.paths()] == [2, 4, 2, 4]
    with pytest.raises(ResetNeeded, match=r"environments \[1, 3\] have ended"):
        env.step(np.zeros(4, dtype=int))
    env.reset(options={"reset_mask": ~mask})
    truncated = env.step(np.zeros(4, dtype=int))[3]  # the refused step left no trace
    assert not truncated.any()
    assert env.step(np.zeros(4, dtype=int))[3].tolist() == mask.tolist()


@pytest.mark.parametrize("mask", [np.zeros(2, bool), np.ones(3, bool), np.ones(2), [1, 0]])
def test_a_bad_reset_mask_is_refused(mask):
    env = gymnasium.make_vec(ID, num_envs=2)
    env.reset()
    with pytest.raises(ValueError, match="reset_mask must hold 2 bools"):
        env.reset(options={"reset_mask": mask})


def test_a_goal_that_the_own_start_cannot_reach_is_refused_where_starts_are_drawn_too():
    env = gymnasium.make_vec(ID, num_envs=20, random_start=0.5, **OFTEN)
    with pytest.raises(ValueError, match="must differ from the goal"):
        env.reset(seed=0, options={"goal": OFTEN["start"]})
    env.reset(seed=0, options={"goal": OFTEN["start"], "start": OFTEN["goal"]})


@pytest.mark.parametrize("observation", ["dict", "map"])
def test_environments_with_goals_of_their_own_equal_single_ones(observation):
    kwargs = {
        "observation": observation,
        "target_db": -62.2,
        "max_episode_steps": 25,
        "patch_radius": 3,
    }
    kwargs["infos"] = "all"
    ends = [((20, 35), (24, 33)), ((30, 22), (33, 20)), ((20, 35), (15, 36)), ((0, 20), (3, 22))]
    ours = gymnasium.make_vec(ID, num_envs=4, autoreset_mode="Disabled", **kwargs)
    singles = [gymnasium.make(ID, **kwargs) for _ in ends]
    ours.reset(seed=0)
    rng = np.random.default_rng(0)

    def begin(i):
        options = {"start": ends[i][0], "goal": ends[i][1]}
        _, infos = ours.reset(options={**options, "reset_mask": np.arange(4) == i})
        assert (
            infos["oracle_distance"][i] == singles[i].reset(options=options)[1]["oracle_distance"]
        )

    for i in range(4):
        begin(i)
    reached = 0
    for _ in range(1500):
        actions = rng.integers(0, 8, 4)
        obs, reward, terminated, truncated, infos = ours.step(actions)
        for i, (env, action) in enumerate(zip(singles, actions, strict=True)):
            one = env.step(action)
            mine = obs[i] if observation == "map" else {key: value[i] for key, value in obs.items()}
            assert_same(mine, one[0])
            assert (reward[i], terminated[i], truncated[i]) == one[1:4]
            for key in ("distance", "distance_to_go", "is_success", "spl", "margin_db", "refused"):
                assert infos[key][i] == one[4][key], key
            if one[2] or one[3]:
                assert ours.paths()[i] == env.unwrapped.path
                reached += one[2]
                begin(i)
    assert reached > 20


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_goal_set_at_the_reset_outlasts_the_episodes_of_others(mode):
    env = gymnasium.make_vec(ID, num_envs=2, max_episode_steps=4, autoreset_mode=mode, infos="all")
    env.reset(options={"goal": (20, 35)})
    for _ in range(2):
        env.step(np.array([4, 4]))
    env.reset(options={"goal": (20, 35), "start": (10, 35), "reset_mask": np.array([False, True])})
    to_go = [env.step(np.array([4, 4]))[4]["distance_to_go"].tolist() for _ in range(3)]
    assert [each[1] for each in to_go] == [5.5, 6.0, 6.5]
    assert to_go[2][0] != to_go[0][0]  # the other has begun anew, towards the scene's goal


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.array([0, 8]), r"actions\[1\]=8 must be an integer from 0 to 7"),
        (np.array([-1, 0]), r"actions\[0\]=-1 must be an integer from 0 to 7"),
        (np.array([0, 255], dtype=np.uint8), r"actions\[1\]=255 must be"),
        (np.array([0.0, 1.0]), "type float64, but one integer for each of the 2"),
        (np.array([True, False]), "type bool"),
        (np.array([0]), r"shape \(1,\)"),
        (3, r"shape \(\)"),
    ],
)
def test_bad_actions_are_refused_before_anything_moves(actions, message):
    env = gymnasium.make_vec(ID, num_envs=2)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(np.array([0, 0]))
    env.reset()
    with pytest.raises(ValueError, match=message):
        env.step(actions)
    infos = env.step(np.array([0, 0]))[4]
    assert infos["distance"].tolist() == [0.5, 0.5]


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int32, np.uint64, np.int64, list])
def test_actions_of_every_integer_type_are_taken(kind):
    env = gymnasium.make_vec(ID, num_envs=2)
    env.reset()
    actions = [0, 1] if kind is list else np.array([0, 1], dtype=kind)
    assert env.step(actions)[4]["distance"].tolist() == [0.5, 0.5 * 2**0.5]


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"num_envs": 0}, "num_envs=0 must be a positive integer"),
        ({"max_episode_steps": 0}, "max_episode_steps=0 must be"),
        ({"autoreset_mode": "Never"}, "autoreset_mode='Never' must be one of"),
        ({"render_mode": "video"}, "render_mode='video' must be one of"),
    ],
)
def test_bad_vector_arguments_are_refused_by_name(kwargs, message):
    with pytest.raises(ValueError, match=message):
        IrsNavVectorEnv(**{"num_envs": 2, **kwargs})


def test_pictures_and_texts_are_those_of_single_environments():
    for mode in ("ansi", "rgb_array"):
        ours = gymnasium.make_vec(ID, num_envs=2, render_mode=mode, max_episode_steps=5)
        single = gymnasium.make(ID, render_mode=mode)
        ours.reset(seed=0), single.reset(seed=0)
        for action in (0, 1, 4, 2):
            ours.step(np.array([action, 4]))
            single.step(action)
        np.testing.assert_array_equal(ours.render()[0], single.render())
    assert gymnasium.make_vec(ID, num_envs=2).render() is None


def test_gymnasiums_vector_wrappers_fit():
    def last_infos(wrapper):
        env = wrapper(
            gymnasium.make_vec(ID, num_envs=3, observation="flat", max_episode_steps=6, infos="all")
        )
        env.reset(seed=0)
        return [env.step(np.full(3, 4))[4] for _ in range(6)][-1]

    assert last_infos(gymnasium.wrappers.vector.RecordEpisodeStatistics)["episode"][
        "l"
    ].tolist() == [6, 6, 6]
    assert [info["refused"] for info in last_infos(gymnasium.wrappers.vector.DictInfoToList)] == [
        6,
        6,
        6,
    ]


@pytest.mark.parametrize("env_id", [ID, "irs_gym:IrsNavRandom-v0"])
@pytest.mark.parametrize("observation", ["dict", "flat", "map", "masked", "cell"])
@pytest.mark.parametrize("copy", [True, False])
def test_each_array_of_an_observation_is_in_one_piece(env_id, observation, copy):
    """JAX takes no views with gaps, so `gymnasium.wrappers.vector.ArrayConversion` fails at them."""
    kwargs = {"scenes": str(SCENES)} if "Random" in env_id else {}
    env = gymnasium.make_vec(env_id, num_envs=3, observation=observation, copy=copy, **kwargs)
    for seen in (env.reset(seed=0)[0], env.step(np.zeros(3, dtype=np.int64))[0]):
        arrays = seen.values() if isinstance(seen, dict) else [seen]
        assert all(each.flags.c_contiguous for each in arrays)
