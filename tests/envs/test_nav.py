"""Facts about the single environment: the contract with Gymnasium and Stable-Baselines3, and its
own rules.
"""

import copy
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence

import irs_gym
from irs_gym.grid import MOVE_LENGTHS, MOVES
from irs_gym.mdp.packing import MARGIN_SCALE_DB

ID = "irs_gym:IrsNav-v0"
OBSERVATIONS = ["dict", "flat", "map"]
CONSTRAINTS = ["refuse", "terminate", "allow"]
KINDS = [
    *((o, c) for o in OBSERVATIONS for c in CONSTRAINTS),
    ("masked", "terminate"),
    ("cell", "refuse"),
]
EVERY = [pytest.param(o, c, id=f"{o}-{c}") for o, c in KINDS]


def make(**kwargs):
    return gymnasium.make(ID, **kwargs)


def rollout(env, seed, steps=300):
    """All that an environment says over some random steps."""
    env.action_space.seed(seed)
    said = [env.reset(seed=seed)]
    for _ in range(steps):
        said.append(env.step(env.action_space.sample()))
        if said[-1][2] or said[-1][3]:
            said.append(env.reset())
    return said


# --- the contract ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("observation", "constraint"), EVERY)
@pytest.mark.filterwarnings("error")
def test_gymnasiums_checker_finds_nothing(observation, constraint):
    env = make(observation=observation, constraint=constraint, random_start=0.5)
    with warnings.catch_warnings():
        # says so of every made environment, whose wrappers it is right to avoid
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version.*")
        warnings.filterwarnings(
            "ignore", message=".*to get variables from other wrappers is deprecated.*"
        )
        check_env(env, skip_render_check=False)
    check_env(env.unwrapped, skip_render_check=False)


@pytest.mark.parametrize(("observation", "constraint"), EVERY)
@pytest.mark.filterwarnings("error")
def test_stable_baselines_checker_finds_nothing(observation, constraint):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        if observation == "dict":  # the patch is no picture, and the one remark that is expected
            warnings.filterwarnings("ignore", message=".*gain_patch.*|.*unconventional shape.*")
        if observation == "map":  # takes each array of three axes for a uint8 picture
            warnings.filterwarnings(
                "ignore", message="It seems that your observation (space )? is an image"
            )
        checker.check_env(
            make(observation=observation, constraint=constraint), skip_render_check=False
        )


@pytest.mark.parametrize(("observation", "constraint"), EVERY)
def test_equal_seeds_give_equal_rollouts_and_copies_go_on_alike(observation, constraint):
    env = make(observation=observation, constraint=constraint, random_start=True)
    first = rollout(env, 5)
    assert data_equivalence(first, rollout(env, 5))  # again, in the same environment
    assert data_equivalence(first, rollout(make(**env.spec.kwargs), 5))
    env.reset(seed=8, options={"start": (20, 36)})  # far from all violations
    env.step(0)
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = [env.step(action) for action in (1, 2, 3, 4, 5, 6, 7, 0)]
    for twin in twins:
        assert data_equivalence(
            expected, [twin.step(action) for action in (1, 2, 3, 4, 5, 6, 7, 0)]
        )


@pytest.mark.parametrize(("observation", "constraint"), EVERY)
def test_a_spec_survives_json(observation, constraint):
    env = make(observation=observation, constraint=constraint, start=(0, 21), max_episode_steps=70)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec.to_json() == env.spec.to_json()
    assert data_equivalence(rollout(env, 1, 100), rollout(again, 1, 100))


def test_different_seeds_differ():
    starts = {
        tuple(make(random_start=True).reset(seed=seed)[0]["position"].tolist())
        for seed in range(20)
    }
    assert len(starts) > 15


def test_other_processes_see_the_same():
    code = (
        "import gymnasium, hashlib, numpy as np\n"
        f"env = gymnasium.make({ID!r}, random_start=True, observation='flat', phase_bits=2)\n"
        "out = hashlib.sha256()\n"
        "obs, info = env.reset(seed=3)\n"
        "for action in np.random.default_rng(0).integers(0, 8, 200):\n"
        "    out.update(obs.tobytes() + repr((info['distance'], info['margin_db'])).encode())\n"
        "    obs, reward, terminated, truncated, info = env.step(action)\n"
        "    out.update(repr(reward).encode())\n"
        "    if terminated: obs, info = env.reset()\n"
        "print(out.hexdigest())\n"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
    assert len(runs[0].strip()) == 64


def test_closing_twice_does_no_harm():
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    env.close()
    env.close()


def test_step_returns_pythons_own_types():
    env = make()
    env.reset(seed=0)
    _, reward, terminated, truncated, info = env.step(np.int64(0))
    assert [type(each) for each in (reward, terminated, truncated)] == [float, bool, bool]
    kinds = {key: type(value) for key, value in info.items()}
    assert kinds == {
        "distance": float,
        "refused": int,
        "distance_to_go": float,
        "gain_db": float,
        "margin_db": float,
        "action_mask": np.ndarray,
        "is_refused": bool,
        "cost": float,
        "is_success": bool,
        "spl": float,
        "oracle_distance": float,
    }
    assert info["action_mask"].dtype == np.int8


def test_registering_is_idempotent():
    before = dict(gymnasium.envs.registry)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        import importlib

        importlib.reload(irs_gym)
    assert dict(gymnasium.envs.registry) == before


@pytest.mark.parametrize("mode", ["rgb_array", "ansi", "rgb_array_list"])
def test_render_modes(mode):
    env = make(render_mode=mode)
    env.reset(seed=0)
    first = env.render()
    env.step(1)
    second = env.render()
    if mode == "ansi":
        assert "R" in first
        assert first != second
    elif mode == "rgb_array":
        assert (first.dtype, first.ndim, first.shape[2]) == (np.uint8, 3, 3)
        assert (first != second).any()
    else:
        assert len(first) == len(second) == 1


# --- the rules ------------------------------------------------------------------------------------


def follow(env, cells):
    """Step along neighbouring cells; returns the last step and the sum of rewards."""
    total, last = 0.0, None
    for step in np.diff(cells, axis=0):
        last = env.step(int(np.flatnonzero((step == MOVES).all(axis=1))[0]))
        total += last[1]
    return last, total


@pytest.mark.parametrize("constraint", CONSTRAINTS)
@pytest.mark.parametrize("target_db", [-63.0, -61.8, -61.2, -60.0])
def test_the_oracles_path_succeeds_exactly(constraint, target_db):
    env = make(constraint=constraint, target_db=target_db)
    _, info = env.reset(seed=0)
    oracle = env.unwrapped.oracle
    (_, _, terminated, truncated, last), total = follow(env, oracle.cells)
    assert terminated
    assert not truncated
    assert last["is_success"]
    assert last["spl"] == pytest.approx(1.0, abs=1e-12)
    assert last["distance"] == pytest.approx(info["oracle_distance"], abs=1e-9)
    assert oracle.distance == pytest.approx(info["oracle_distance"], abs=1e-9)
    assert env.unwrapped.path == [tuple(cell) for cell in oracle.cells.tolist()]
    octile = 39 * 0.5  # start and goal are in one row
    assert total == pytest.approx(10.0 + octile - oracle.distance, abs=1e-9)


@pytest.mark.parametrize(
    ("constraint", "shaping"), [("refuse", True), ("refuse", False), ("terminate", True)]
)
@pytest.mark.parametrize("target_db", [-62.5, -61.8, -60.0])
def test_no_policy_has_a_larger_return_than_the_oracles_path(constraint, shaping, target_db):
    """Value iteration over the environment's own steps, undiscounted, with as many steps left as it
    allows.
    """
    env = make(constraint=constraint, target_db=target_db, shaping=shaping).unwrapped
    free = np.argwhere(np.isfinite(env.radio_map.gain_db) & (env.radio_map.gain_db >= target_db))
    number = {tuple(cell): n for n, cell in enumerate(free.tolist())}
    to, reward, goes_on = (np.zeros((len(free), 8), dtype=kind) for kind in (int, float, bool))
    for n, cell in enumerate(free.tolist()):
        if tuple(cell) == env.world.goal or not np.isfinite(
            env._episode.tables.distance_to_go[tuple(cell)]
        ):
            to[n] = n
            continue
        for action in range(8):
            env.reset(options={"start": tuple(cell)})
            _, reward[n, action], terminated, _, _ = env.step(action)
            to[n, action], goes_on[n, action] = number[env.path[-1]], not terminated
    value = np.zeros(len(free))
    for _ in range(400):
        value = np.max(reward + goes_on * value[to], axis=1)
    env.reset()
    _, best = follow(env, env.oracle.cells)
    assert value[number[env.world.start]] == pytest.approx(best, abs=1e-9)


def test_a_refused_move_costs_the_move_and_leaves_the_robot():
    env = make()
    obs, _ = env.reset(seed=0)
    after, reward, terminated, _, info = env.step(4)  # into the wall, westwards
    assert reward == -0.5
    assert not terminated
    assert info["is_refused"]
    assert (info["refused"], info["distance"], info["cost"]) == (1, 0.0, 0.0)
    assert data_equivalence(obs, after)
    assert env.unwrapped.path == [(0, 20)]


def below_target(env):
    """A cell from which one move leads below the target, with that move."""
    world = env.unwrapped.world
    for cell in np.argwhere(
        world.feasible & np.isfinite(env.unwrapped._episode.tables.distance_to_go)
    ).tolist():
        for action, (di, dj) in enumerate(MOVES.tolist()):
            there = (cell[0] + di, cell[1] + dj)
            if (
                world.radio_map.grid.has(there)
                and world.radio_map.free[there]
                and not world.feasible[there]
            ):
                return tuple(cell), action, there
    raise AssertionError("the target is met everywhere")


def test_a_cell_below_the_target_is_refused_or_ends_the_episode_or_costs():
    start, action, there = below_target(make())
    env = make(start=start)
    env.reset()
    _, reward, terminated, _, info = env.step(action)
    assert (reward, terminated) == (-0.5 * MOVE_LENGTHS[action], False)
    assert info["is_refused"]
    assert info["cost"] == 0.0

    env = make(start=start, constraint="terminate")
    env.reset()
    _, _, terminated, _, info = env.step(action)
    assert terminated
    assert not info["is_success"]
    assert (info["cost"], info["spl"], info["distance"]) == (1.0, 0.0, 0.0)
    assert env.unwrapped.path == [start]

    env = make(start=start, constraint="allow")
    env.reset()
    _, _, terminated, _, info = env.step(action)
    assert not terminated
    assert env.unwrapped.path[-1] == there
    assert (info["cost"], info["distance"]) == (1.0, 0.5 * MOVE_LENGTHS[action])
    assert info["margin_db"] < 0


def test_an_allowed_violation_spoils_the_success():
    env = make(constraint="allow")
    env.reset()
    everywhere = irs_gym.shortest_path(env.unwrapped.radio_map.free, (0, 20), (39, 20), 0.5)
    (_, _, terminated, _, info), _ = follow(env, everywhere.cells)
    assert terminated
    assert everywhere.distance < env.unwrapped.oracle.distance
    assert not info["is_success"]
    assert info["spl"] == 0.0
    _, info = env.reset()
    assert info["cost"] == 0.0


def test_the_mask_tells_which_moves_are_refused():
    env = make(random_start=True)
    for seed in range(30):
        _, info = env.reset(seed=seed)
        assert info["action_mask"].astype(bool).tolist() == env.unwrapped.action_masks().tolist()
        for action in range(8):
            env.reset(seed=seed)
            assert env.step(action)[4]["is_refused"] == (not info["action_mask"][action])
        assert info["action_mask"][env.action_space.sample(mask=info["action_mask"])]


def test_a_random_start_reaches_the_goal_and_is_scored_against_its_own_optimum():
    env = make(random_start=True)
    starts = set()
    for seed in range(200):
        _, info = env.reset(seed=seed)
        start = env.unwrapped.path[0]
        starts.add(start)
        assert start != (39, 20)
        shortest = irs_gym.shortest_path(env.unwrapped.world.feasible, start, (39, 20), 0.5)
        assert info["oracle_distance"] == pytest.approx(shortest.distance, abs=1e-9)
    assert len(starts) > 120
    half = make(random_start=0.5)
    fixed = sum(
        half.reset(seed=seed)[0] is not None and half.unwrapped.path[0] == (0, 20)
        for seed in range(200)
    )
    assert 70 < fixed < 130


def test_start_and_goal_of_an_episode_are_options_and_no_longer():
    env = make()
    env.reset(options={"start": (20, 35), "goal": (30, 35)})
    assert env.unwrapped.oracle.distance == pytest.approx(5.0)
    assert env.unwrapped.oracle.cells[[0, -1]].tolist() == [[20, 35], [30, 35]]
    env.reset()
    assert env.unwrapped.oracle.cells[[0, -1]].tolist() == [[0, 20], [39, 20]]


def test_a_new_start_costs_no_run_of_dijkstra(monkeypatch):
    import irs_gym.mdp.dynamics

    env = make(target_db=-61.75)
    runs = []
    original = irs_gym.mdp.dynamics.distance_to_go
    monkeypatch.setattr(
        irs_gym.mdp.dynamics, "distance_to_go", lambda *a, **k: runs.append(a) or original(*a, **k)
    )
    for i in range(10, 30):
        env.reset(options={"start": (i, 35)})
    assert not runs
    env.reset(options={"goal": (30, 35)})
    assert len(runs) == 1
    env.reset(options={"goal": (30, 35), "start": (12, 35)})
    assert len(runs) == 1


# --- observations ---------------------------------------------------------------------------------


def test_the_observation_says_what_the_map_says():
    env = make(phase_bits=2, target_db=-61.9, patch_radius=3)
    obs, info = env.reset(options={"start": (15, 15)})
    gain = env.unwrapped.radio_map.gain_db
    margin = np.clip((gain[12:19, 12:19] + 61.9) / MARGIN_SCALE_DB, -1, 1)
    np.testing.assert_allclose(obs["gain_patch"], margin, atol=1e-6)
    x, y = env.unwrapped.radio_map.grid.centre((15, 15))
    np.testing.assert_allclose(
        obs["position"], [x / 10, y / 10, (39 - 15) / 40, (20 - 15) / 40], atol=1e-6
    )
    shifts = irs_gym.build_phase_shifts("paper", phase_bits=2)[15, 15]
    np.testing.assert_allclose(obs["irs"], [1, 0.5, 1 - 2 / 2.2, *(shifts / np.pi - 1)], atol=1e-6)
    assert info["gain_db"] == gain[15, 15]
    assert info["margin_db"] == pytest.approx(gain[15, 15] + 61.9)


def test_the_patch_is_minus_one_outside_and_in_obstacles():
    env = make()
    corner, _ = env.reset(options={"start": (0, 39)})
    assert (corner["gain_patch"][:5] == -1).all()
    assert (corner["gain_patch"][:, 6:] == -1).all()
    beside, _ = env.reset(options={"start": (9, 28)})  # an obstacle begins one cell to the east
    assert (beside["gain_patch"][6:, 5] == -1).all()
    assert beside["gain_patch"][5, 5] > -1


def test_flat_is_dict_flattened():
    kwargs = {"phase_bits": 1, "random_start": True}
    as_dict, flat = make(**kwargs), make(observation="flat", **kwargs)
    for seed in range(10):
        one, other = as_dict.reset(seed=seed)[0], flat.reset(seed=seed)[0]
        np.testing.assert_array_equal(
            gymnasium.spaces.flatten(as_dict.observation_space, one), other
        )


def test_the_map_shows_margin_obstacles_robot_and_goal():
    env = make(observation="map")
    obs, _ = env.reset(options={"start": (3, 30)})
    gain = env.unwrapped.radio_map.gain_db
    np.testing.assert_allclose(obs[0], np.clip((gain + 61.8) / MARGIN_SCALE_DB, -1, 1), atol=1e-6)
    np.testing.assert_array_equal(obs[1] == 1, ~np.isfinite(gain))
    assert np.argwhere(obs[2]).tolist() == [[3, 30]]
    assert np.argwhere(obs[3]).tolist() == [[39, 20]]
    moved = env.step(0)[0]
    assert np.argwhere(moved[2]).tolist() == [[4, 30]]
    assert np.argwhere(obs[2]).tolist() == [[3, 30]]  # the last observation stays as it was


def test_phases_are_left_out_on_request_and_without_irs():
    assert make(irs_phases=False).observation_space["irs"].shape == (3,)
    bare = make(irs_elements=0, target_db=-62.5)
    assert bare.observation_space["irs"].shape == (3,)
    assert bare.reset()[0]["irs"].tolist() == [-1, -1, -1]


def test_a_world_too_large_for_a_table_is_observed_all_the_same(monkeypatch):
    import irs_gym.mdp.observation

    kept = make(observation="flat", target_db=-61.79)
    monkeypatch.setattr(irs_gym.mdp.observation, "_LARGEST_TABLE", 0)
    computed = make(
        observation="flat", target_db=-61.79, irs_phases=True, goal_bonus=10.5
    )  # another world
    assert kept.unwrapped._episode.observer.table is not None
    assert computed.unwrapped._episode.observer.table is None
    for seed in range(5):
        for one, other in zip(rollout(kept, seed, 20), rollout(computed, seed, 20), strict=True):
            np.testing.assert_array_equal(one[0], other[0])


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"target_db": -59.0},
            r"target_db=-59\.0 is infeasible.*highest feasible target is -59\.51",
        ),
        ({"target_db": float("nan")}, "target_db=nan must be a finite number"),
        ({"cell_size": 0.3}, "cell_size=0.3 does not divide"),
        ({"phase_bits": 0}, "phase_bits=0 must be an integer from 1"),
        ({"quantiser": "best"}, "quantiser='best' must be one of"),
        ({"array_model": "best"}, "array_model='best' must be one of"),
        ({"irs_elements": 1210}, "irs_elements=1210 does not fill whole rows"),
        ({"patch_radius": -1}, "patch_radius=-1 must be"),
        ({"observation": "image"}, "observation='image' must be one of"),
        ({"constraint": "forbid"}, "constraint='forbid' must be one of"),
        ({"random_start": 1.5}, "random_start=1.5 must be"),
        ({"goal_bonus": -1.0}, "goal_bonus=-1.0 must not be negative"),
        ({"start": (8, 8)}, r"start=\(8, 8\) lies in an obstacle"),
        ({"goal": (40, 0)}, r"goal=\(40, 0\) lies off the map"),
        ({"start": (39, 20)}, r"start=\(39, 20\) must differ from the goal"),
        ({"start": (1.5, 2)}, r"start=\(1.5, 2\) must be a cell"),
        ({"constraint": "terminate", "shaping": False}, "goal_bonus=10.0 is too small"),
        ({"radio_map": "nowhere.npz"}, "start must be given"),
    ],
)
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_bad_arguments_are_refused_by_name(kwargs, message, kind):
    with pytest.raises(ValueError, match=message):
        make(**kwargs) if kind == "single" else gymnasium.make_vec(ID, num_envs=2, **kwargs)


def test_the_target_named_for_an_infeasible_one_is_feasible():
    with pytest.raises(ValueError, match="highest feasible target is") as error:
        make(target_db=-59.0)
    make(target_db=float(str(error.value).split()[-2]))


def test_unknown_arguments_and_scenes_are_refused_by_name():
    with pytest.raises(
        TypeError,
        match=r"IrsNavEnv.__init__\(\) got an unexpected keyword argument .traget_db.: the arguments are scene",
    ):
        make(traget_db=-61.8)
    with pytest.raises(FileNotFoundError, match="scene='factory' is neither a file nor one of"):
        make(scene="factory")


@pytest.mark.parametrize("action", [8, -1, 0.0, 1.5, True, None, "E", np.array([1, 2])])
def test_actions_that_are_none_are_refused(action):
    env = make().unwrapped
    env.reset()
    with pytest.raises(ValueError, match="must be an integer from 0 to 7"):
        env.step(action)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"begin": (0, 0)}, "unknown key begin"),
        ({"start": (39, 20)}, "must differ from the goal"),
        ({"start": (8, 8)}, "lies in an obstacle"),
        ({"start": 7}, "start=7 must be a cell"),
        ({"start": (-1, 0)}, "lies off the map"),
        ({"start": (39, 10)}, "is infeasible from"),
    ],
)
def test_bad_options_are_refused_by_name(options, message):
    env = make()
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)


def test_stepping_needs_an_episode():
    env = make(start=(38, 20)).unwrapped
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(0)
    env.reset()
    assert env.step(0)[2]
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(0)
