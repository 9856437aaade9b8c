"""Facts about the environment whose robot switches the panel's configuration."""

import json
import pickle

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, assert_same, both
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from irs_gym import Codebook, codebook_gain_db, focused_codebook, joint_shortest_path
from irs_gym.grid import MOVE_LENGTHS, MOVES
from irs_gym.vector import codebook_model

ID = "irs_gym:IrsNavCodebook-v0"
START, GOAL = (0, 20), (39, 20)
# a codebook that is quickly made, and that leads to the goal
CELLS = [(12, 19), (22, 15), (31, 22), (4, 20), (36, 22), (20, 35)]
FEW = focused_codebook("paper", CELLS)
# close ends and a short limit: many episodes of every kind in few steps
OFTEN = {
    "codebook": FEW,
    "target_db": -62.2,
    "patch_radius": 2,
    "start": (30, 22),
    "goal": (33, 20),
    "max_episode_steps": 30,
}


def make(**kwargs):
    return gymnasium.make(ID, **{"codebook": FEW, **kwargs})


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
def test_vector_env_equals_n_single_envs(constraint, mode):
    steps = 10_000 if (constraint, mode) == ("refuse", AutoresetMode.NEXT_STEP) else 1_500
    kwargs = {"constraint": constraint, "random_start": 0.5, "goal_bonus": 30.0, **OFTEN}
    ours, single = both(ID, 5, mode, **kwargs)
    assert assert_equal_for(steps // 5, ours, single) > steps // 50


@pytest.mark.parametrize("observation", ["flat", "masked", "cell"])
def test_observations_of_every_kind_are_equal_in_both(observation):
    ours, single = both(
        ID, 3, AutoresetMode.SAME_STEP, observation=observation, random_start=True, **OFTEN
    )
    assert assert_equal_for(200, ours, single) > 12


def test_without_tables_the_same_happens(monkeypatch):
    kwargs = {"random_start": 0.5, "constraint": "allow", "infos": "all", **OFTEN}
    kept = gymnasium.make_vec(ID, num_envs=4, **kwargs)
    monkeypatch.setattr(codebook_model, "LARGEST_TABLES", 0)
    codebook_model.model_of.cache_clear()
    asked = gymnasium.make_vec(ID, num_envs=4, **kwargs)
    codebook_model.model_of.cache_clear()
    assert kept.unwrapped._sampler.transition_model.tables is not None
    assert asked.unwrapped._sampler.transition_model.tables is None

    assert_same(kept.reset(seed=3), asked.reset(seed=3))
    rng = np.random.default_rng(0)
    for _ in range(500):
        actions = rng.integers(14, size=4)
        assert_same(kept.step(actions), asked.step(actions))


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
def test_steps_are_those_of_the_rules_written_down_once_more(constraint):
    """By hand, over the gains alone: moves and switches, what they cost, and when it is over."""
    env = make(constraint=constraint, target_db=-62.0, goal_bonus=40.0, switch_cost=0.7).unwrapped
    gain_db = codebook_gain_db("paper", FEW)
    free = np.isfinite(gain_db[0])
    meets = gain_db >= -62.0
    rng = np.random.default_rng(0)
    (i, j), k = START, int(gain_db[:, 0, 20].argmax())
    env.reset(options={"start": START})
    distance = metres = switches = refused = 0

    def octile(i, j):
        apart = sorted(np.abs(np.subtract(GOAL, (i, j))))
        return 0.5 * (apart[1] + (2**0.5 - 1) * apart[0])

    for _ in range(1500):
        mask = env.action_masks()
        # mostly what is not refused, so that the robot gets about
        action = int(rng.choice(np.flatnonzero(mask)) if rng.random() < 0.8 else rng.integers(14))
        if action < 8:
            (a, b), to = np.add((i, j), MOVES[action]), k
            length = MOVE_LENGTHS[action] * 0.5
            is_open = 0 <= a < 40 and 0 <= b < 40 and free[a, b]
        else:
            (a, b), to, length = (i, j), action - 8, 0.7
            is_open = to != k
        is_met = is_open and meets[to, a, b]
        is_done = is_open if constraint == "allow" else is_met
        is_missed = {
            "refuse": False,
            "terminate": is_open and not is_met,
            "allow": not meets[(to, a, b) if is_done else (k, i, j)],
        }[constraint]
        before = octile(i, j)
        if is_done:
            (i, j), k = (int(a), int(b)), to
            distance += length
            metres += length * (action < 8)
            switches += action >= 8
        refused += not is_done
        is_there = is_done and (i, j) == GOAL
        _, reward, terminated, _, info = env.step(action)
        assert bool(mask[action]) == is_done
        assert reward == pytest.approx(-length + before - octile(i, j) + 40.0 * is_there)
        assert terminated == (is_there or (constraint == "terminate" and is_missed))
        assert info["cost"] == is_missed
        assert (info["configuration"], env.path[-1]) == (k, (i, j))
        assert info["gain_db"] == gain_db[k, i, j]
        assert (info["switches"], info["refused"]) == (switches, refused)
        assert (info["distance"], info["metres"]) == pytest.approx((distance, metres))
        if terminated:
            (i, j), k = START, int(gain_db[:, 0, 20].argmax())
            env.reset()
            distance = metres = switches = refused = 0


@pytest.mark.parametrize("switch_cost", [0.0, 0.5, 3.0])
def test_the_best_actions_lead_to_the_goal_at_the_joint_oracles_cost(switch_cost):
    env = make(switch_cost=switch_cost, target_db=-61.5)
    _, info = env.reset()
    gain_db = codebook_gain_db("paper", FEW)
    path = joint_shortest_path(gain_db, -61.5, START, GOAL, 0.5, switch_cost)
    assert info["oracle_distance"] == pytest.approx(path.distance, abs=1e-9)
    assert env.unwrapped.oracle.distance == path.distance
    assert path.switches > 0
    while not info["is_success"]:
        *_, info = env.step(int(env.unwrapped.optimal_actions()[0]))
    assert info["distance"] == pytest.approx(path.distance, abs=1e-9)
    assert info["metres"] + switch_cost * info["switches"] == pytest.approx(info["distance"])
    assert info["spl"] == pytest.approx(1.0)


def test_the_exact_values_of_a_table_are_the_oracles_returns():
    env = make(target_db=-61.5).unwrapped
    env.reset()
    q = env.optimal_q(1.0)  # (K * X * Y, 14), undiscounted
    state = env.states[0]
    octile = 39 * 0.5
    assert q[state].max() == pytest.approx(10.0 + octile - env.oracle.distance, abs=1e-9)
    table = env.transition_table()
    assert table.next_cell.shape == (6 * 1600, 14)


def test_an_episode_begins_in_the_strongest_configuration_or_in_the_one_asked_for():
    env = make(target_db=-62.0)
    gain_db = codebook_gain_db("paper", FEW)
    assert env.reset()[1]["configuration"] == gain_db[:, 0, 20].argmax()
    meeting = np.flatnonzero(gain_db[:, 12, 19] >= -62.0).tolist()
    for k in meeting:
        _, info = env.reset(options={"start": (12, 19), "configuration": k})
        assert (info["configuration"], info["switches"]) == (k, 0)
    others = sorted({*range(6)} - {*meeting})
    with pytest.raises(
        ValueError, match=f"from configuration {others[0]}: the highest joint target"
    ):
        env.reset(options={"start": (12, 19), "configuration": others[0]})
    for wrong in (6, -1, 1.5, True, "one"):
        with pytest.raises(ValueError, match=r"configuration=.* must be a number from 0 to 5"):
            env.reset(options={"configuration": wrong})


def test_random_starts_draw_cell_and_configuration_among_all_that_lead_to_the_goal():
    env = make(target_db=-62.0, random_start=True)
    drawn = {}
    for seed in range(300):
        _, info = env.reset(seed=seed)
        assert np.isfinite(info["oracle_distance"])
        assert info["margin_db"] >= 0
        drawn.setdefault(info["configuration"], set()).add(env.unwrapped.path[0])
    to_go = env.unwrapped.maps.to_go[0]
    reaching = {k for k in range(6) if np.isfinite(to_go[k]).sum() > 60}
    assert reaching <= set(drawn)
    assert len(set.union(*drawn.values())) > 150
    _, info = env.reset(seed=0, options={"configuration": 2})
    assert info["configuration"] == 2


def test_observations_tell_the_configuration_and_all_gains_here():
    env = make(observation="dict", target_db=-62.0, irs_phases=True)
    observation, info = env.reset()
    gain_db = codebook_gain_db("paper", FEW)
    assert observation["configuration"].tolist() == np.eye(6)[info["configuration"]].tolist()
    expected = np.clip((gain_db[:, 0, 20] + 62.0) / 5.0, -1, 1).astype(np.float32)
    np.testing.assert_array_equal(observation["gains"], expected)
    assert observation["gain_patch"][5, 5] == expected[info["configuration"]]
    held = FEW.phase_shifts[info["configuration"]]
    np.testing.assert_allclose(
        np.mod(held, 2 * np.pi) / np.pi - 1, observation["irs"][3:], atol=1e-6
    )
    flat = make(observation="flat", target_db=-62.0, irs_phases=True).reset()[0]
    np.testing.assert_array_equal(
        flat, gymnasium.spaces.flatten(env.observation_space, observation)
    )
    decoded = env.unwrapped.packing.decode(observation)
    assert (int(decoded.configuration), int(decoded.cell)) == (info["configuration"], 20)
    assert make(target_db=-62.0).observation_space["irs"].shape == (3,)


@pytest.mark.parametrize("observation", ["dict", "flat", "masked", "cell"])
@pytest.mark.parametrize("constraint", ["refuse", "allow"])
def test_gymnasiums_checker_is_silent(observation, constraint, recwarn):
    check_env(make(observation=observation, constraint=constraint, random_start=0.5).unwrapped)
    assert not [str(each.message) for each in recwarn]


@pytest.mark.parametrize("observation", ["dict", "flat"])
def test_stable_baselines3s_checker_is_silent(observation, recwarn):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make(observation=observation).unwrapped)
    # the patch is no picture, and the one remark that is expected
    others = [each for each in recwarn if "unconventional shape" not in str(each.message)]
    assert not [str(each.message) for each in others]


def test_a_state_goes_on_as_it_did_before():
    env = make(target_db=-62.0).unwrapped
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(60):
        env.step(int(rng.choice(np.flatnonzero(env.action_masks()))))
    state = env.get_state()
    actions = rng.integers(14, size=50).tolist()
    first = [env.step(action) for action in actions]
    env.set_state(state)
    assert_same(tuple(first), tuple(env.step(action) for action in actions))
    with pytest.raises(ValueError, match="state is damaged"):
        env.set_state(state[:-1] + bytes([state[-1] ^ 1]))
    with pytest.raises(ValueError, match="state is of another task"):
        make(target_db=-62.5).unwrapped.set_state(state)
    with pytest.raises(ValueError, match="must be the 58 bytes"):
        gymnasium.make("irs_gym:IrsNav-v0").unwrapped.set_state(state)


def test_robots_with_goals_of_their_own_equal_single_ones():
    kwargs = {"codebook": FEW, "target_db": -62.2, "max_episode_steps": 25, "infos": "all"}
    ends = [((20, 35), (24, 33)), ((30, 22), (33, 20)), ((20, 35), (15, 36)), ((0, 20), (3, 22))]
    ours = gymnasium.make_vec(ID, num_envs=4, autoreset_mode="Disabled", **kwargs)
    singles = [gymnasium.make(ID, **kwargs) for _ in ends]
    ours.reset(seed=0)
    for env in singles:
        env.reset()

    def begin(i):
        options = {"start": ends[i][0], "goal": ends[i][1]}
        _, infos = ours.reset(options={**options, "reset_mask": np.arange(4) == i})
        one = singles[i].reset(options=options)[1]
        assert infos["oracle_distance"][i] == one["oracle_distance"]

    for i in range(4):
        begin(i)
    rng = np.random.default_rng(0)
    reached = 0
    for _ in range(1000):
        actions = rng.integers(0, 14, 4)
        obs, reward, terminated, truncated, infos = ours.step(actions)
        for i, (env, action) in enumerate(zip(singles, actions, strict=True)):
            one = env.step(action)
            assert_same({key: value[i] for key, value in obs.items()}, one[0])
            assert (reward[i], terminated[i], truncated[i]) == one[1:4]
            for key in ("distance", "distance_to_go", "spl", "switches", "metres", "refused"):
                assert infos[key][i] == one[4][key], key
            if one[2] or one[3]:
                assert ours.paths()[i] == env.unwrapped.path
                reached += one[2]
                begin(i)
    assert reached > 10


def test_specs_survive_json_and_pickles_the_task(tmp_path):
    FEW.save(tmp_path / "few.npz")
    for codebook in (
        FEW,
        tmp_path / "few.npz",
        str(tmp_path / "few.npz"),
        FEW.to_data(),
        ["dft", 4],
    ):
        env = gymnasium.make(ID, codebook=codebook, target_db=-63.2, max_episode_steps=9)
        again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
        copy = pickle.loads(pickle.dumps(env))
        for each in (again, copy):
            assert_same(env.reset(seed=1), each.reset(seed=1))
    json.dumps(FEW.to_data())


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"codebook": ("dft", 0)}, "codebook=.* must be a Codebook"),
        ({"codebook": ("sparse", 3)}, "codebook=.* must be a Codebook"),
        ({"codebook": 7}, "codebook=7 must be a Codebook"),
        ({"codebook": {"phase_shifts": []}}, "codebook holds"),
        ({"codebook": FEW, "scene": "workshop"}, "codebook: it holds phase shifts of 60"),
        ({"codebook": FEW, "irs_elements": 600}, "codebook: "),
        ({"codebook": FEW, "irs_elements": 0}, "no IRS panel to configure"),
        ({"codebook": FEW, "phase_bits": 1}, "phase_bits and quantiser cannot be given"),
        ({"switch_cost": -0.5}, "switch_cost=-0.5 must be"),
        ({"switch_cost": float("nan")}, "switch_cost=nan must be"),
        ({"switch_cost": float("inf")}, "switch_cost=inf must be"),
        ({"switch_cost": True}, "switch_cost=True must be"),
        ({"codebook": FEW, "target_db": -50.0}, "highest joint target is -6"),
        ({"codebook": FEW, "target_db": float("nan")}, "target_db"),
        ({"codebook": FEW, "observation": "map"}, "observation='map' must be one of"),
        ({"codebook": FEW, "start": (16, 30)}, "start=.* lies in an obstacle"),
        ({"codebook": FEW, "goal": START}, "must differ from the goal"),
        ({"codebook": FEW, "split": "train"}, "codebook must be a design and a size"),
        ({"split": "train", "target_db": -62.0}, "target_db cannot be given along with split"),
        ({"split": "train", "scenes": "folder"}, "split cannot be given along with scenes"),
        ({"split": "nowhere"}, "split='nowhere'"),
        ({"split": "val", "num_scenes": 0}, "num_scenes=0 must be"),
        ({"codebook": FEW, "constraint": "terminate", "goal_bonus": 1.0}, "goal_bonus=1.0 is too"),
    ],
)
def test_bad_arguments_are_refused_by_name(kwargs, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(ID, **kwargs)


def test_bad_phases_and_damaged_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match="NaN or inf"):
        Codebook.from_array(np.full((2, 60), np.nan))
    with pytest.raises(FileNotFoundError):
        gymnasium.make(ID, codebook="nowhere.npz")
    (tmp_path / "broken.npz").write_bytes(b"no codebook")
    with pytest.raises(ValueError, match="is not a codebook"):
        gymnasium.make(ID, codebook=tmp_path / "broken.npz")


@pytest.mark.parametrize(
    ("action", "said"), [(14, "from 0 to 13: 0 E"), (-1, "then a switch"), (True, "True must be")]
)
def test_bad_actions_are_refused(action, said):
    env = make()
    env.reset()
    with pytest.raises(ValueError, match=said):
        env.step(action)


def test_what_would_fill_memory_is_refused_before_any_work(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "20MiB")
    with pytest.raises(
        ValueError, match=r"codebook, cell_size=0\.5: 5000 configurations of 1 maps"
    ):
        gymnasium.make(ID, codebook=("dft", 5000))


def test_pictures_show_the_present_configuration_and_the_switches():
    env = make(target_db=-61.5, render_mode="ansi")
    vector = gymnasium.make_vec(ID, num_envs=2, codebook=FEW, target_db=-61.5, render_mode="ansi")
    env.reset(), vector.reset()
    is_over = False
    texts = [env.render()]
    while not is_over:
        action = int(env.unwrapped.optimal_actions()[0])
        *_, is_over, _, info = env.step(action)
        texts.append(env.render())
        if not is_over:
            vector.step(np.array([action, 0]))
            assert vector.render()[0] == texts[-1]
    assert texts[0].splitlines()[0].startswith("configuration ")
    assert texts[0].count("x") > texts[-1].count("x")  # the robot's own switches lie over them
    assert texts[-1].count("X") - texts[0].count("X") >= info["switches"] > 0
    labels = {text.splitlines()[0].split("   ")[0] for text in texts}
    assert len(labels) == info["switches"] + 1
    image = make(target_db=-61.5, render_mode="rgb_array")
    image.reset()
    assert image.render().shape[2] == 3


def test_many_scenes_are_each_feasible_and_equal_in_both(tmp_path):
    kwargs = {"split": "train", "num_scenes": 3, "codebook": ("focused", 6), "patch_radius": 2}
    ours, single = both(ID, 3, AutoresetMode.SAME_STEP, max_episode_steps=40, **kwargs)
    assert_equal_for(300, ours, single)
    env = gymnasium.make(ID, **kwargs)
    for number in range(3):
        _, info = env.reset(options={"scene_id": number})
        assert (info["scene_number"], info["scene_id"]) == (number, f"train-{number}")
        assert np.isfinite(info["oracle_distance"])
        assert env.unwrapped.oracle.distance == pytest.approx(info["oracle_distance"], abs=1e-9)
    seen = {env.reset(seed=n)[1]["scene_number"] for n in range(20)}
    assert seen == {0, 1, 2}
    with pytest.raises(ValueError, match="scene_id='train-3' must be a name"):
        env.reset(options={"scene_id": "train-3"})
    with pytest.raises(ValueError, match="unknown key scene_id"):
        make().reset(options={"scene_id": 0})
