"""Facts of the agents over whole maps: planning, labels, symmetries, policies, and learners."""

import pickle
from dataclasses import replace
from functools import partial
from io import BytesIO

import gymnasium
import numpy as np
import pytest
import torch
from tiny_pool import resized, tiny_pool

from agents.learning.imitation import imitation_loss
from agents.learning.map_configs import (
    ImitationConfig,
    PlannerConfig,
    PlannerPpoConfig,
    UNetConfig,
    UNetPpoConfig,
    VinConfig,
)
from agents.learning.map_learner import MapLearner, first_network
from agents.learning.symmetry import SYMMETRIES, sources, turn, turn_moves
from agents.learning.whole_map_ppo import transition_tables_of
from agents.networks.map_network import (
    MapPlan,
    NetworkFileError,
    build_network,
    maps_of,
    pack_network,
    plan_scene_set,
    unpack_network,
)
from agents.networks.planner import COST, PlanningNetwork, plan, value_iteration
from agents.policies.map_policy import MapPolicy
from agents.policies.model_file import read_network
from agents.rollout.scene_set import follow, play_scene_set
from irs_gym.grid import MOVE_LENGTHS, MOVES, legal_moves
from irs_gym.oracle.shortest_path import optimal_moves

POOL = tiny_pool()
SMALL = {
    "planner": PlannerConfig(total_scenes=24, batch_scenes=4),
    "unet": UNetConfig(total_scenes=24, batch_scenes=4, width=8, passes=2),
    "vin": VinConfig(total_scenes=24, batch_scenes=4, rounds=5, width=8),
    "planner_ppo": PlannerPpoConfig(total_timesteps=256, scenes=2, robots=4, n_steps=8),
    "unet_ppo": UNetPpoConfig(
        total_timesteps=256, scenes=2, robots=4, n_steps=8, width=8, passes=2
    ),
}


class Nothing:
    """A callback that does nothing."""

    def __getattr__(self, name):
        return lambda *_: True


def true_costs(pool, dtype=torch.float64):
    """The length of each move that is not refused, and a very high cost for the others."""
    legal = np.stack([legal_moves(each) for each in pool.feasible]).transpose(0, 3, 1, 2)
    return torch.from_numpy(np.where(legal, MOVE_LENGTHS[:, None, None], 1e5)).to(dtype)


def goals(pool):
    return maps_of(pool, np.arange(len(pool)))[:, 2] > 0


def barred(pool):
    """The moves that the environment refuses, (S, 8, X, Y)."""
    return ~torch.from_numpy(legal_moves(pool.feasible)).permute(0, 3, 1, 2)


def oracle_logits(pool):
    return np.where(optimal_moves(pool.distance_to_go, pool.cell_size), 0.0, -1e4).astype(
        np.float32
    )


def learn(config, pool=POOL, seed=0):
    return MapLearner(config, pool, seed).learn(config.total_timesteps, Nothing())


def weights(learner):
    return [each.detach().numpy() for each in learner.teacher.network.parameters()]


@pytest.mark.parametrize("shape", [(9, 7), (16, 16)])
def test_planner_with_the_true_costs_gives_dijkstras_distances(shape):
    pool = tiny_pool(8, shape, seed=3)
    to_go = plan(true_costs(pool), goals(pool)).to_go.numpy() * pool.cell_size
    can_reach = np.isfinite(pool.distance_to_go)
    np.testing.assert_allclose(to_go[can_reach], pool.distance_to_go[can_reach], rtol=1e-12)
    assert (to_go[pool.feasible & ~can_reach] >= 1e4).all()


def test_planner_with_the_true_costs_takes_the_optimal_moves_only():
    logits = plan(true_costs(POOL), goals(POOL)).logits.numpy()
    can_reach = np.isfinite(POOL.distance_to_go) & (POOL.distance_to_go > 0)
    expected = optimal_moves(POOL.distance_to_go, POOL.cell_size)
    np.testing.assert_array_equal(
        (logits > -1e-9).transpose(0, 2, 3, 1)[can_reach], expected.transpose(0, 2, 3, 1)[can_reach]
    )
    episodes = follow(logits, POOL)
    assert episodes.is_success.all()
    np.testing.assert_allclose(episodes.distance, POOL.oracle_distance, rtol=1e-12)


def test_way_through_a_labyrinth_is_found_whatever_its_length():
    free = np.ones((21, 21), dtype=bool)
    for wall in range(1, 21, 2):
        free[wall] = False
        free[wall, 0 if wall % 4 == 1 else -1] = True
    costs = torch.from_numpy(np.where(legal_moves(free), MOVE_LENGTHS, 1e4).transpose(2, 0, 1))[
        None
    ]
    is_goal = torch.zeros(1, 21, 21, dtype=torch.bool)
    is_goal[0, 20, 20] = True
    assert 190 < plan(costs, is_goal).to_go[0, 0, 20] < 240
    few = partial(value_iteration, rounds=20)
    assert plan(costs, is_goal, search=few).to_go[0, 0, 20] > 1e4


def test_gradient_of_the_planner_equals_that_of_unrolled_rounds():
    generator = torch.Generator().manual_seed(1)
    costs = torch.rand(2, 8, 5, 6, generator=generator, dtype=torch.float64) + 0.1
    is_goal = torch.zeros(2, 5, 6, dtype=torch.bool)
    is_goal[0, 1, 2] = is_goal[1, 4, 5] = True
    upstream = torch.rand(2, 5, 6, generator=generator, dtype=torch.float64)

    def unrolled(costs):
        to_go = torch.where(is_goal, 0.0, 1e9).to(costs)
        for _ in range(30):
            padded = torch.nn.functional.pad(to_go, (1, 1, 1, 1), value=1e9)
            ahead = [padded[:, 1 + di : 6 + di, 1 + dj : 7 + dj] for di, dj in MOVES]
            to_go = torch.where(is_goal, 0.0, (costs + torch.stack(ahead, dim=1)).amin(dim=1))
        return to_go

    found = []
    for to_go in (unrolled, lambda costs: plan(costs, is_goal).to_go):
        leaf = costs.clone().requires_grad_()
        (to_go(leaf) * upstream).sum().backward()
        found.append(leaf.grad)
    torch.testing.assert_close(*found)
    assert found[0].abs().sum() > 0


def test_unreached_cells_and_the_border_leak_into_no_logit_or_gradient():
    costs = torch.ones(1, 8, 6, 6, requires_grad=True)
    is_goal = torch.zeros(1, 6, 6, dtype=torch.bool)
    is_goal[0, 0, 0] = True
    found = plan(costs, is_goal, search=partial(value_iteration, rounds=1))
    (found.logits.sum() + found.to_go[found.to_go < 1e8].sum()).backward()
    assert torch.isfinite(costs.grad).all()
    assert torch.isfinite(found.logits).all()
    off_map = ~torch.from_numpy(legal_moves(np.ones((6, 6), dtype=bool))).permute(2, 0, 1)
    whole = plan(costs, is_goal).logits[0]
    assert whole[off_map].max() < whole[~off_map].min()


def test_what_lies_beyond_the_frame_and_padding_in_it_are_the_same_to_the_planner():
    small, large = tiny_pool(4, (9, 7)), tiny_pool(4, (9, 7))
    gain_db = np.full((4, 12, 11), -np.inf)
    gain_db[:, :9, :7] = small.gain_db
    to_go = np.full((4, 12, 11), np.inf)
    to_go[:, :9, :7] = small.distance_to_go
    large = replace(small, gain_db=gain_db, distance_to_go=to_go)
    for encoding in ("mask", "margin"):
        network = PlanningNetwork(encoding)
        inner = network.encode(maps_of(large, np.arange(4)))
        assert not inner[:, :, 9:].any()
        assert torch.equal(inner[:, :, :9, :7], network.encode(maps_of(small, np.arange(4))))


def test_planner_takes_no_mask_where_it_is_to_learn_it():
    pool = replace(POOL, gain_db=np.where(POOL.free, POOL.target_db[:, None, None] - 1e-4, -np.inf))
    maps = maps_of(pool, np.arange(len(pool)))
    just_below, just_above = maps.clone(), maps.clone()
    just_above[:, 0] = torch.where(maps[:, 1] > 0, maps[:, 0], 1e-4 / 5.0)
    mask, margin = PlanningNetwork("mask"), PlanningNetwork("margin")
    assert (mask.encode(just_above) - mask.encode(just_below)).abs().max() == 1.0
    assert (margin.encode(just_above) - margin.encode(just_below)).abs().max() < 0.05
    with pytest.raises(ValueError, match="encoding='all' must be one of"):
        PlanningNetwork("all")


@pytest.mark.parametrize("bias", [-1e3, 0.0, 1e3])
def test_costs_stay_within_their_bounds(bias):
    network = PlanningNetwork()
    with torch.no_grad():
        network.costs[-1].bias += bias
    maps = maps_of(POOL, np.arange(len(POOL)))
    can_reach = torch.from_numpy(np.isfinite(POOL.distance_to_go))
    moves = plan(torch.ones(len(POOL), 8, *POOL.shape), goals(POOL), is_barred=barred(POOL)).to_go
    to_go = network(maps).to_go
    assert (to_go >= COST[0] * moves - 1e-4)[can_reach].all()
    assert (to_go <= COST[1] * moves + 1e-4)[can_reach].all()


def test_at_first_all_moves_cost_the_same():
    network = PlanningNetwork("margin")
    costs = network.costs(network.encode(maps_of(POOL, np.arange(len(POOL)))))
    assert (costs == 0.0).all()


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_symmetries_turn_labels_into_the_labels_of_the_turned_map(symmetry):
    labels = torch.from_numpy(optimal_moves(POOL.distance_to_go, 0.5))
    turned = turn(torch.tensor(POOL.distance_to_go), symmetry).numpy()
    np.testing.assert_array_equal(turn_moves(labels, symmetry).numpy(), optimal_moves(turned, 0.5))


def test_the_eight_symmetries_differ_and_each_permutes_the_moves():
    corner = torch.arange(4.0).view(2, 2)
    assert len({tuple(turn(corner, each).flatten().tolist()) for each in SYMMETRIES}) == 8
    assert all(sorted(sources(each)) == list(range(8)) for each in SYMMETRIES)


def test_labels_are_the_moves_that_begin_a_shortest_path():
    labels = optimal_moves(POOL.distance_to_go, POOL.cell_size)
    for scene, i, j in np.argwhere(np.isfinite(POOL.distance_to_go)):
        here = POOL.distance_to_go[scene, i, j]
        for move, (di, dj) in enumerate(MOVES):
            ni, nj = i + di, j + dj
            on_map = 0 <= ni < 9 and 0 <= nj < 7
            there = POOL.distance_to_go[scene, ni, nj] if on_map else np.inf
            is_best = here > 0 and np.isclose(there + MOVE_LENGTHS[move] * 0.5, here, rtol=1e-9)
            assert labels[scene, move, i, j] == is_best
    assert not labels.transpose(0, 2, 3, 1)[~np.isfinite(POOL.distance_to_go)].any()


def test_loss_is_zero_for_the_oracle_and_log_eight_for_one_that_knows_nothing_of_a_single_best_move():
    labels = torch.from_numpy(optimal_moves(POOL.distance_to_go, POOL.cell_size))
    assert imitation_loss(torch.from_numpy(oracle_logits(POOL)), labels) == 0.0
    single = labels & (labels.sum(dim=1, keepdim=True) == 1)
    assert imitation_loss(torch.zeros(labels.shape), single) == pytest.approx(np.log(8))


def test_loss_has_a_finite_gradient():
    labels = torch.from_numpy(optimal_moves(POOL.distance_to_go, POOL.cell_size))
    logits = torch.zeros(labels.shape, requires_grad=True)
    imitation_loss(logits, labels).backward()
    assert torch.isfinite(logits.grad).all()
    assert not logits.grad.movedim(1, -1)[~labels.any(dim=1)].any()


def test_episodes_of_a_pool_equal_those_followed_step_by_step():
    pool = tiny_pool(40, seed=5)
    logits = (
        np.random.default_rng(0).normal(size=(40, 8, 9, 7)).astype(np.float32)
        + oracle_logits(pool) / 5e3
    )
    episodes = follow(logits, pool, max_steps=60)
    for n in range(40):
        cell, distance = tuple(pool.start[n].tolist()), 0.0
        for _ in range(60):
            if cell == tuple(pool.goal[n].tolist()):
                break
            move = logits[n, :, cell[0], cell[1]].argmax()
            if legal_moves(pool.feasible[n])[*cell, move]:
                cell = tuple((np.array(cell) + MOVES[move]).tolist())
                distance += MOVE_LENGTHS[move] * pool.cell_size
        is_success = cell == tuple(pool.goal[n].tolist())
        assert episodes.is_success[n] == is_success
        assert episodes.distance[n] == pytest.approx(distance)
        assert episodes.spl[n] == pytest.approx(
            pool.oracle_distance[n] / distance if is_success else 0.0
        )
    assert 0 < episodes.is_success.mean() < 1
    assert episodes.ratio >= 1.0


def observation(pool, scene, cell):
    """The environment's map observation, (4, X, Y)."""
    margin, obstacle, goal = maps_of(pool, np.array([scene]))[0].numpy()
    robot = np.zeros_like(goal)
    robot[*cell] = 1.0
    return np.stack([margin, obstacle, robot, goal])


@pytest.fixture
def policy():
    torch.manual_seed(0)
    policy = MapPolicy(
        "planner", {"encoding": "mask", "width": 4}, build_network("planner", {"width": 4})
    )
    policy.calls = []
    policy.network.register_forward_hook(lambda _, given, __: policy.calls.append(len(given[0])))
    return policy


def test_policy_asks_its_network_once_for_each_map_and_goal(policy):
    for cell in [(0, 0), (3, 4), (8, 6)]:
        policy.predict(observation(POOL, 0, cell), deterministic=True)
    assert policy.calls == [1]
    policy.predict(
        np.stack([observation(POOL, scene, (1, 1)) for scene in (0, 1, 2, 1)]), deterministic=True
    )
    assert policy.calls == [1, 1, 1]  # each alone, as a batch would change its last digits
    policy.predict(observation(tiny_pool(1, (5, 6)), 0, (1, 1)), deterministic=True)
    assert policy.calls == [1, 1, 1, 1]
    seen = observation(POOL, 0, (1, 1))
    seen[3] = np.roll(seen[3], 1)
    policy.predict(seen, deterministic=True)
    assert policy.calls == [1, 1, 1, 1, 1]


def test_policy_chooses_what_the_network_likes_best_in_the_robots_cell(policy):
    logits = plan_scene_set(policy.network, POOL)
    for cell in [(0, 0), (3, 4)]:
        batch = np.stack([observation(POOL, scene, cell) for scene in range(len(POOL))])
        actions, state = policy.predict(batch, "kept", deterministic=True)
        assert state == "kept"
        np.testing.assert_array_equal(actions, logits[:, :, *cell].argmax(axis=1))
        single, _ = policy.predict(batch[1], deterministic=True)
        assert single.shape == ()
        assert single == actions[1]


def test_policy_draws_moves_as_likely_as_the_network_says(policy):
    seen = np.repeat(observation(POOL, 0, (3, 3))[None], 4000, axis=0)
    actions, _ = policy.predict(seen)
    likely = (
        torch.from_numpy(plan_scene_set(policy.network, POOL)[0, :, 3, 3]).softmax(dim=0).numpy()
    )
    np.testing.assert_allclose(np.bincount(actions, minlength=8) / 4000, likely, atol=0.03)


@pytest.mark.parametrize("algorithm", SMALL)
def test_network_is_kept_without_pickles_and_comes_back_the_same(algorithm):
    learner = learn(SMALL[algorithm])
    file = BytesIO()
    learner.save(file)
    kept = read_network(file.getvalue())
    np.testing.assert_array_equal(
        plan_scene_set(kept.network, POOL), plan_scene_set(learner.teacher.network, POOL)
    )
    assert pack_network(*unpack_network(file.getvalue())) == file.getvalue()


@pytest.mark.parametrize("harm", ["cut", "pickle", "other"])
def test_damaged_network_file_is_refused(harm):
    torch.manual_seed(0)
    content = pack_network("planner", {"width": 4}, build_network("planner", {"width": 4}))
    if harm == "cut":
        content = content[: len(content) // 2]
    elif harm == "pickle":
        content = pickle.dumps(print)
    else:
        content = pack_network("planner", {"width": 5}, unpack_network(content)[2])
    with pytest.raises(NetworkFileError, match="does not hold a network"):
        unpack_network(content)


@pytest.mark.parametrize("algorithm", SMALL)
def test_learner_taken_up_from_a_checkpoint_ends_with_the_same_weights(algorithm):
    config = SMALL[algorithm]
    whole = learn(config, seed=4)
    half = MapLearner(config, POOL, 4).learn(config.total_timesteps // 2, Nothing())
    half = pickle.loads(pickle.dumps(half))
    assert half.pool is None
    half.pool = POOL
    half.learn(config.total_timesteps - half.num_timesteps, Nothing(), reset_num_timesteps=False)
    assert half.num_timesteps == whole.num_timesteps
    for ours, theirs in zip(weights(half), weights(whole), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("algorithm", SMALL)
def test_same_seed_gives_the_same_weights_and_another_seed_others(algorithm):
    first, again, other = (weights(learn(SMALL[algorithm], seed=seed)) for seed in (1, 1, 2))
    assert all(map(np.array_equal, first, again))
    assert not all(map(np.array_equal, first, other))


def test_imitation_sees_each_scene_once_before_any_a_second_time(monkeypatch):
    seen = []
    config = PlannerConfig(total_scenes=12, batch_scenes=2)
    learner = MapLearner(config, POOL, 0)
    draw = learner.teacher._draw
    monkeypatch.setattr(
        learner.teacher, "_draw", lambda scenes: seen.append(draw(scenes)) or seen[-1]
    )
    learner.learn(12, Nothing())
    assert [sorted(np.concatenate(seen[n : n + 3]).tolist()) for n in (0, 3)] == [
        list(range(6))
    ] * 2


def test_planner_learns_the_way_on_maps_of_another_size_by_imitation():
    config = PlannerConfig(total_scenes=1600)
    pool, others = tiny_pool(64, (10, 10)), tiny_pool(50, (14, 17), seed=9)
    before = play_scene_set(MapLearner(config, pool, 0).policy, others)
    after = play_scene_set(learn(config, pool).policy, others)
    assert before.is_success.all()
    assert before.spl.mean() < 0.97
    assert after.spl.mean() > 0.995


def test_planner_learns_the_way_by_ppo_alone():
    pool = tiny_pool(64, (10, 10))
    config = PlannerPpoConfig(total_timesteps=60_000, scenes=8, robots=16)
    before, after = (
        play_scene_set(each.policy, pool)
        for each in (MapLearner(config, pool, 0), learn(config, pool))
    )
    assert before.is_success.all()
    assert before.spl.mean() < 0.97
    assert after.spl.mean() > 0.995


@pytest.mark.parametrize("cell_size", [0.5, 0.25])
def test_rules_of_ppo_are_those_of_the_environment_in_cells(cell_size):
    pool = resized(POOL, cell_size)
    env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=pool)
    rules = transition_tables_of(pool, np.arange(len(pool)))
    shape = (len(pool), *pool.shape)
    seen = set()
    for scene, i, j in np.argwhere(np.isfinite(pool.distance_to_go) & (pool.distance_to_go > 0)):
        flat = np.ravel_multi_index((scene, i, j), shape)
        for move in range(8):
            env.reset(options={"scene_id": int(scene), "start": (int(i), int(j))})
            _, reward, is_over, _, info = env.step(move)
            end = np.ravel_multi_index((scene, *env.unwrapped.path[-1]), shape)
            assert rules.ahead[flat, move] == end
            assert rules.is_over[flat, move] == is_over
            assert rules.reward[flat, move] * cell_size == pytest.approx(reward, abs=1e-5)
            seen.add((bool(is_over), bool(info["is_refused"])))
    assert seen == {(False, False), (False, True), (True, False)}


@pytest.mark.parametrize(("cell_size", "bonus"), [(0.5, 20.0), (0.25, 40.0)])
def test_the_last_move_pays_the_bonus_of_ten_metres(cell_size, bonus):
    """It brings the robot as much nearer as it costs, so that nothing but the bonus is left."""
    rules = transition_tables_of(resized(POOL, cell_size), np.arange(len(POOL)))
    assert rules.is_over.sum() > len(POOL)
    np.testing.assert_allclose(rules.reward[rules.is_over], bonus, rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "setting", "message"),
    [
        (PlannerConfig, {"total_scenes": 0}, "total_scenes=0 must be a positive integer"),
        (PlannerConfig, {"to_go_coef": -1.0}, "to_go_coef=-1.0 must not be negative"),
        (PlannerPpoConfig, {"gamma": 1.5}, "gamma=1.5 must be a number from 0 to 1"),
        (PlannerPpoConfig, {"ent_coef": -0.1}, "ent_coef=-0.1 must not be negative"),
        (UNetPpoConfig, {"learning_rate": 0.0}, "learning_rate=0.0 must be a positive number"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(kind, setting, message):
    with pytest.raises(ValueError, match=message):
        kind(**setting)


def test_ppo_goes_on_from_the_weights_of_imitation(tmp_path):
    learner = learn(SMALL["unet"])
    with (tmp_path / "unet.npz").open("wb") as file:
        learner.save(file)
    again = MapLearner(replace(SMALL["unet_ppo"], weights=tmp_path / "unet.npz"), POOL, 1)
    assert all(map(np.array_equal, weights(learner), weights(again)))
    with pytest.raises(ValueError, match=r"hold unet .* not unet"):
        MapLearner(replace(SMALL["unet_ppo"], width=16, weights=tmp_path / "unet.npz"), POOL, 1)


def test_networks_answer_for_maps_of_any_size():
    maps = maps_of(tiny_pool(2, (11, 13)), np.arange(2))
    for config in SMALL.values():
        found = first_network(config)(maps)
        assert isinstance(found, MapPlan)
        assert found.logits.shape == (2, 8, 11, 13)
        assert found.to_go.shape == (2, 11, 13)


def test_every_imitation_setting_has_a_default_but_the_length_of_the_schedule():
    with pytest.raises(TypeError, match="total_scenes"):
        ImitationConfig()
