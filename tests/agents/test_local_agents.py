"""Facts of agents that see a patch of many scenes: memory, guesses, plans, and episodes over whole
pools.
"""

from dataclasses import replace
from io import BytesIO

import gymnasium
import numpy as np
import pytest
import torch
from tiny_pool import resized, tiny_pool

from agents.learning.dagger import Dagger
from agents.learning.explorer_ppo import ExplorerPpo
from agents.learning.local_configs import ExplorerConfig, ExplorerPpoConfig, RobotBatchConfig
from agents.learning.map_configs import network_settings
from agents.learning.map_learner import MapLearner, first_network
from agents.learning.ppo_loss import clipped_loss, generalized_advantages, sample_actions
from agents.learning.robot_batch import RobotBatch
from agents.learning.sb3_configs import LocalPpoConfig
from agents.networks.explorer import (
    BLOCKED,
    KNOWN_EXTRA,
    LEAST_EXTRA,
    MOST_EXTRA,
    PRIOR,
    ExplorerNetwork,
    costs_of_moves,
)
from agents.networks.local_extractor import FRAME, LocalExtractor
from agents.policies.belief_map import BeliefMap, patches_of
from agents.policies.explorer_policy import Explorer, decode_local
from agents.policies.map_policy import MapPolicy
from agents.policies.model_file import read_network
from agents.policies.replanning import Replanner
from agents.rollout.episode import evaluation_env, roll_out
from agents.rollout.scene_set import SceneSetResults, most_steps, play_scene_set
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS, MOVES, legal_moves
from irs_gym.mdp.task import Task
from irs_gym.oracle.shortest_path import detours_of_moves, distance_to_go

POOL = tiny_pool(6, (9, 7))


def explorer(seed=0, shape=(9, 7), optimistic=False) -> Explorer:
    torch.manual_seed(seed)
    network = ExplorerNetwork(width=8)
    if optimistic:
        with torch.no_grad():
            network.answer.weight.zero_()
            network.answer.bias[0] = 100.0  # all cells cost as little as they may
            network.answer.bias[2] = -100.0
    return Explorer({"width": 8}, network, shape)


def env_of(pool, **more):
    return gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=pool, **more)


def one_room(feasible, start, goal) -> SceneSet:
    """A pool of one scene, all of whose cells that are not feasible are obstacles."""
    gain_db, irs = np.where(feasible, 0.0, -np.inf)[None], np.zeros((1, 3), dtype=np.float32)
    to_go = distance_to_go(feasible, goal, 0.5)[None]
    ends = np.array([[start], [goal]])  # (2, 1, 2)
    return SceneSet((), ("room",), np.array([-1.0]), gain_db, to_go, irs, *ends, 0.5)


def test_memory_is_the_union_of_all_that_was_in_view():
    rng = np.random.default_rng(0)
    cells = np.stack(
        [np.argwhere(POOL.feasible[n])[rng.integers(8, size=5)] for n in range(6)]
    )  # (6, 5, 2)
    seen, scenes = BeliefMap.nothing(6, POOL.shape, 2), np.arange(6)
    for step in range(5):
        seen = seen.look(cells[:, step], patches_of(POOL, scenes, cells[:, step], 2))
    margin = np.clip((POOL.gain_db - POOL.target_db[:, None, None]) / 5.0, -1.0, 1.0).astype(
        np.float32
    )
    places = np.indices(POOL.shape).transpose(1, 2, 0)
    for n in range(6):
        near = (np.abs(places[:, :, None] - cells[n]).max(axis=-1) <= 2).any(axis=-1)
        np.testing.assert_array_equal(np.isnan(seen.maps[n]), ~near)
        np.testing.assert_array_equal(seen.maps[n][near], margin[n][near])
    assert np.isnan(seen.forget(np.array([1])).maps[1]).all()
    assert not np.isnan(seen.maps[1]).all()  # who forgets makes a new memory


@pytest.mark.parametrize("observation", ["flat", "dict"])
def test_patches_of_a_pool_are_those_of_the_environment(observation):
    env = env_of(POOL, observation=observation, patch_radius=2)
    for n in range(len(POOL)):
        seen, _ = env.reset(options={"scene_id": n})
        parts = decode_local(seen, POOL.shape)
        patch = patches_of(POOL, np.array([n]), POOL.start[[n]], 2)[0]
        np.testing.assert_array_equal(parts.margin, patch)
        np.testing.assert_array_equal(parts.irs, POOL.irs[n])


def test_observation_with_other_parts_is_refused_with_what_would_be_right():
    with pytest.raises(ValueError, match=r"observation has 130 numbers.*irs_phases=False"):
        decode_local(np.zeros(130, dtype=np.float32), POOL.shape)


def test_detours_of_moves_are_differences_of_dijkstras_distances():
    extra = detours_of_moves(POOL.distance_to_go, POOL.cell_size)
    for n, feasible in enumerate(POOL.feasible):
        legal = legal_moves(feasible)
        for i, j in np.argwhere(np.isfinite(POOL.distance_to_go[n])):
            for action, (di, dj) in enumerate(
                [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
            ):
                found = extra[n, action, i, j]
                if not legal[i, j, action]:
                    assert found == np.inf
                    continue
                goal = (int(i + di), int(j + dj))
                onward = distance_to_go(feasible, tuple(POOL.goal[n].tolist()), 0.5)[goal]
                expected = MOVE_LENGTHS[action] * 0.5 + onward - POOL.distance_to_go[n, i, j]
                assert found == pytest.approx(expected, abs=1e-12)


def test_move_costs_its_length_times_the_cell_ahead_and_none_leads_off_the_map():
    cost = torch.arange(1.0, 13.0).view(1, 3, 4)
    costs = costs_of_moves(cost)
    assert costs.shape == (1, 8, 3, 4)
    assert costs[0, 0, 1, 2] == cost[0, 2, 2]  # east
    assert costs[0, 1, 1, 2] == pytest.approx(2**0.5 * cost[0, 2, 3].item())
    assert (costs[0, :, 0, 0] >= BLOCKED).sum() == 5


def test_prices_begin_at_the_prior_and_stay_in_their_bounds():
    network = explorer().network
    margin = torch.full((1, 9, 7), torch.nan)
    margin[0, 2:5, 2:5] = 0.5
    margin[0, 3, 4] = -0.5
    for bias, expected in ((1.0, PRIOR), (1e3, LEAST_EXTRA), (-1e3, MOST_EXTRA)):
        with torch.no_grad():
            network.answer.bias[0] = bias
            cost = network.prices(margin, torch.tensor([0])).cost
        np.testing.assert_allclose(cost[margin.isnan()], 1.0 + expected, rtol=1e-6)
        np.testing.assert_allclose(cost[margin >= 0], 1.0 + KNOWN_EXTRA * 0.12, atol=1e-3)
        assert (cost[margin < 0] == BLOCKED).all()


def test_what_is_acted_on_lies_between_the_prior_and_what_was_learned():
    network = explorer().network
    with torch.no_grad():
        network.answer.weight.normal_(generator=torch.Generator().manual_seed(0))
        network.answer.bias.fill_(0.7)
    margin = torch.full((1, 9, 7), torch.nan)
    margin[0, 2:5, 2:5] = 0.5
    goal = torch.tensor([0])
    with torch.no_grad():
        none, half, whole, own = (
            each.prices(margin, goal)
            for each in (
                network.tempered(0.0),
                network.tempered(0.5),
                network.tempered(1.0),
                network,
            )
        )
    np.testing.assert_allclose(none.cost[margin.isnan()], 1.0 + PRIOR, rtol=1e-6)
    assert torch.equal(whole.cost, own.cost)
    unknown = margin.isnan()
    np.testing.assert_allclose(none.feasible[unknown], 1.0)
    np.testing.assert_allclose(half.feasible, (none.feasible + own.feasible) / 2, atol=1e-5)
    assert (half.cost != own.cost).any()
    assert (half.cost != none.cost).any()


def test_a_learner_acts_on_the_share_that_it_trusts():
    config = ExplorerConfig(robots=4, total_timesteps=64, trust=0.25, width=8)
    learner = MapLearner(config, POOL, seed=0)
    with torch.no_grad():
        learner.teacher.network.answer.bias[0] = 2.0
    assert learner.policy.network.answer.bias[0] == 1.25


@pytest.mark.parametrize(
    ("walls", "expected"),
    [
        ([], [0, 3, 6, 9]),
        # in view from x = 4 on: in the way, or beside it
        ([(6, 3)], [0, 3, 4, 7]),
        ([(6, 2), (6, 3), (6, 4)], [0, 3, 4, 7]),
        ([(6, 1), (6, 2), (6, 4)], [0, 3, 6, 9]),
    ],
)
def test_a_plan_holds_for_three_steps_or_until_its_way_is_seen_to_be_closed(
    walls, expected, monkeypatch
):
    feasible = np.ones((12, 7), dtype=bool)
    for cell in walls:
        feasible[cell] = False
    env = env_of(one_room(feasible, (0, 3), (10, 3)), patch_radius=2)

    planned = []
    plan = Explorer._plan
    monkeypatch.setattr(
        Explorer,
        "_plan",
        lambda self, *seen: (planned.append(len(env.unwrapped.path) - 1), plan(self, *seen))[1],
    )
    found = roll_out(explorer(shape=(12, 7), optimistic=True), env)
    assert found.is_success
    assert found.refused == 0  # so that each step is on the path
    assert planned == expected


def test_optimistic_explorer_walks_as_far_as_optimistic_replanning_does_where_nothing_ties(
    monkeypatch,
):
    """Both plan over the same cells: each step of one is a shortest step of the other."""
    monkeypatch.setattr("agents.networks.explorer.LEAST_EXTRA", 0.0)
    policy = explorer(optimistic=True)
    env = env_of(POOL, observation="flat", patch_radius=2)
    for n in range(len(POOL)):
        observation, info = env.reset(options={"scene_id": n})
        is_open, state = np.ones(POOL.shape, dtype=bool), None
        goal, cell, is_over = tuple(POOL.goal[n].tolist()), POOL.start[n], False
        while not is_over:
            patch = decode_local(observation, POOL.shape).margin
            for (a, b), margin in np.ndenumerate(patch):
                i, j = cell[0] + a - 2, cell[1] + b - 2
                if 0 <= i < POOL.shape[0] and 0 <= j < POOL.shape[1]:
                    is_open[i, j] = margin >= 0
            to_go = distance_to_go(is_open, goal, 1.0)
            action, state = policy.predict(observation, state, np.array([False]))
            before = cell
            observation, _, is_terminated, is_truncated, info = env.step(int(action))
            cell = np.asarray(env.unwrapped.path)[-1]
            moved = np.abs(cell - before).sum()
            assert moved in (1, 2)  # never refused: it sees its neighbours
            assert to_go[tuple(before)] == pytest.approx(to_go[tuple(cell)] + moved**0.5, rel=1e-5)
            is_over = is_terminated or is_truncated
        assert info["is_success"]


def test_known_obstacles_are_never_entered_and_unknown_cells_cost_more():
    network = explorer(1).network
    margin = torch.full((1, 8, 8), torch.nan)
    margin[0, 2:5, 2:5] = 0.5
    margin[0, 4, 3] = -0.2
    guess = network(margin, torch.tensor([63]))
    assert guess.feasible.shape == (1, 8, 8)
    assert (guess.plan.logits[0, 0, 3, 3] < -10).all()  # east of (3, 3) lies (4, 3)
    assert guess.plan.to_go[0, 7, 7] == 0
    assert guess.plan.to_go[0, 3, 3] >= 4 * 2**0.5 - 1e-4  # no less than the length over open floor


@pytest.mark.parametrize("kind", ["explorer", "replanning", "planner"])
def test_playing_a_pool_is_playing_each_scene_in_the_environment(kind):
    if kind == "planner":
        from agents.learning.map_configs import PlannerConfig

        policy: object = MapLearner(PlannerConfig(), POOL, 0).policy
        assert isinstance(policy, MapPolicy)
    else:
        policy = explorer() if kind == "explorer" else Replanner(POOL.shape, 5)
    env = env_of(POOL, observation="map" if kind == "planner" else "flat")
    found = play_scene_set(policy, POOL)
    for n in range(len(POOL)):
        episode = roll_out(policy, env, options={"scene_id": n})
        assert episode.is_success == found.is_success[n]
        assert episode.spl == pytest.approx(found.spl[n])
        assert episode.distance == pytest.approx(found.distance[n])


def test_playing_other_frames_takes_their_shape_and_more_steps():
    wide = tiny_pool(3, (20, 9), seed=4)
    assert play_scene_set(explorer(shape=(9, 7), optimistic=True), wide).is_success.all()
    assert most_steps(wide) == gymnasium.spec("IrsNavRandom-v0").max_episode_steps == 400
    assert most_steps(tiny_pool(1, (80, 80))) == 800


def test_a_path_that_rounding_makes_shorter_than_the_oracles_has_an_spl_of_one():
    oracle = np.array([0.3, 0.3, 0.3])
    shorter = SceneSetResults(
        np.array([True, True, False]), np.array([0.3 * (1 - 1e-10), 0.6, 0.1]), oracle
    )
    assert shorter.spl.tolist() == [1.0, 0.5, 0.0]


def test_explorer_remembers_by_its_state_alone():
    policy = explorer()
    env = env_of(POOL, observation="flat")
    first, _ = env.reset(options={"scene_id": 0})
    action, memory = policy.predict(first)
    assert action.shape == ()
    before = memory.belief.margin.copy()
    later, *_ = env.step(int(action))
    _, memory_later = policy.predict(later, memory)
    np.testing.assert_array_equal(memory.belief.margin, before)
    assert np.isnan(memory_later.belief.maps).sum() <= np.isnan(memory.belief.maps).sum()
    batch, _ = policy.predict(np.stack([first, first]), None, np.array([True, True]))
    assert batch.tolist() == [int(action)] * 2
    _, forgot = policy.predict(later, memory, np.array([True]))
    _, fresh = policy.predict(later)
    np.testing.assert_array_equal(forgot.belief.margin, fresh.belief.margin)


def test_explorer_plays_the_single_task_too():
    env = evaluation_env(Task(observation="dict", target_db=-63.0))
    assert roll_out(explorer(shape=(40, 40), optimistic=True), env).is_success


def test_explorer_survives_its_file():
    policy, file = explorer(3), BytesIO()
    policy.save(file)
    kept = read_network(file.getvalue())
    assert isinstance(kept, Explorer)
    np.testing.assert_array_equal(
        play_scene_set(kept, POOL).distance, play_scene_set(policy, POOL).distance
    )


def test_exploration_learns_to_guess_what_was_not_seen():
    pool = tiny_pool(8, (10, 10), seed=1, blocked=0.5)
    config = ExplorerConfig(
        robots=16, n_steps=2, learning_rate=5e-3, patch_radius=2, total_timesteps=10_000
    )
    torch.manual_seed(0)
    teacher = Dagger(config, ExplorerNetwork(8), np.random.default_rng(0))
    seen = [teacher.update(pool, 0.0) for _ in range(80)]
    assert all(steps % 16 == 0 and 16 <= steps <= 48 for steps, _ in seen)
    early, late = (
        np.mean([each["guess_error"] for _, each in some]) for some in (seen[:10], seen[-10:])
    )
    assert late < 0.9 * early
    assert {"detour", "guess_error"} == set(seen[0][1])


def test_robots_of_an_exploration_stay_on_feasible_cells_and_begin_anew_at_the_goal():
    config = ExplorerConfig(robots=12, random_start=0.5, patch_radius=1, max_steps=15)
    torch.manual_seed(0)
    teacher, ends = Dagger(config, ExplorerNetwork(8), np.random.default_rng(0)), 0
    for _ in range(20):
        steps = 0 if teacher._robots is None else teacher._robots.steps.copy()
        teacher.update(POOL, 0.5)
        robots = teacher._robots
        cells, scenes = robots.cells, robots.scenes
        assert POOL.feasible[scenes, cells[:, 0], cells[:, 1]].all()
        assert (cells != POOL.goal[scenes]).any(axis=1).all()
        assert (robots.steps < 15).all()
        here = np.arange(len(cells))
        assert not np.isnan(robots.maps.numpy()[here, cells[:, 0], cells[:, 1]]).any()
        ends += int((robots.steps < steps).sum())
    assert ends > 0


TERMS = RobotBatchConfig(robots=10, patch_radius=1, max_steps=12, random_start=0.5)


def test_robots_of_an_expedition_move_as_the_environment_says():
    rng = np.random.default_rng(0)
    robots, ends = RobotBatch(TERMS, POOL, rng), 0
    for _ in range(40):
        moves, waits = rng.integers(8, size=10), rng.random(10) < 0.2
        before, scenes, steps = robots.cells.copy(), robots.scenes.copy(), robots.steps.copy()
        arrival = robots.move(POOL, moves, waits)
        for n in range(10):
            legal = legal_moves(POOL.feasible[scenes[n]])[*before[n], moves[n]]
            can = bool(legal) and not waits[n]
            np.testing.assert_array_equal(arrival.cells[n], before[n] + MOVES[moves[n]] * can)
            is_there = (arrival.cells[n] == POOL.goal[scenes[n]]).all()
            assert arrival.is_there[n] == is_there
            assert arrival.is_over[n] == (is_there or steps[n] + (not waits[n]) >= 12)
            if not arrival.is_over[n]:
                np.testing.assert_array_equal(robots.cells[n], arrival.cells[n])
                assert robots.steps[n] == steps[n] + (not waits[n])
        margin, goals = robots.known(POOL)
        places = np.arange(10), robots.cells[:, 0], robots.cells[:, 1]
        assert (margin.numpy()[places] >= 0).all()
        np.testing.assert_array_equal(goals.numpy(), POOL.goal[robots.scenes] @ [POOL.shape[1], 1])
        is_feasible, to_go = robots.truth(POOL)
        np.testing.assert_array_equal(is_feasible.numpy(), POOL.feasible[robots.scenes])
        np.testing.assert_allclose(
            to_go.numpy() * POOL.cell_size, POOL.distance_to_go[robots.scenes], rtol=1e-6
        )
        ends += int(arrival.is_over.sum())
        fresh = np.flatnonzero(arrival.is_over)
        assert (robots.steps[fresh] == 0).all()
        # who begins anew knows what it sees, and nothing else
        np.testing.assert_array_equal(
            ~margin.isnan().numpy()[fresh], robots.in_view().numpy()[fresh]
        )
    assert ends > 10


def ppo(**more):
    config = ExplorerPpoConfig(
        robots=12, n_plans=3, plan_steps=4, patch_radius=2, width=8, total_timesteps=1, **more
    )
    torch.manual_seed(0)
    return ExplorerPpo(config, first_network(config), np.random.default_rng(0))


@pytest.mark.parametrize("cell_size", [0.5, 0.25])
def test_rewards_of_an_episode_are_the_environments(cell_size):
    """In units of a cell: minus the length of the move, plus progress, plus the bonus at the goal."""
    pool = resized(POOL, cell_size)
    teacher = ppo()
    env = env_of(pool, observation="flat", patch_radius=2)
    teacher._robots = robots = RobotBatch(teacher.config.terms, pool, np.random.default_rng(1))
    compared = 0
    for _ in range(15):
        scenes, fresh = robots.scenes.copy(), robots.steps == 0
        with torch.no_grad():
            stage = teacher._advance(pool, robots)
        for n in np.flatnonzero(fresh):
            if stage.cells[0, n] != pool.start[scenes[n]] @ [pool.shape[1], 1]:
                continue  # the environment would begin elsewhere
            env.reset(options={"scene_id": int(scenes[n])})
            for k in range(4):
                if not stage.took[k, n]:
                    break
                _, reward, is_over, *_ = env.step(int(stage.actions[k, n]))
                assert stage.rewards[k, n] * pool.cell_size == pytest.approx(reward, abs=1e-4)
                assert stage.not_done[k, n] == (not is_over)
                compared += 1
    assert compared > 20


def test_advantages_are_those_of_the_returns_where_lambda_is_one():
    rng = np.random.default_rng(0)
    rewards, values = rng.normal(size=(2, 7, 3)).astype(np.float32)
    last, not_done = (
        rng.normal(size=3).astype(np.float32),
        (rng.random((7, 3)) < 0.7).astype(np.float32),
    )
    ahead = np.concatenate([values[1:], last[None]])
    found = generalized_advantages(rewards + 0.9 * not_done * ahead - values, not_done, 0.9)
    following = last
    for t in reversed(range(7)):
        following = rewards[t] + 0.9 * not_done[t] * following
        np.testing.assert_allclose(found[t], following - values[t], rtol=1e-4, atol=1e-5)


def test_loss_of_a_policy_that_has_not_changed_is_that_of_the_policy_gradient():
    torch.manual_seed(1)
    logits, config = (
        torch.randn(50, 8, requires_grad=True),
        ExplorerPpoConfig(ent_coef=0.0, vf_coef=0.0),
    )
    rng = np.random.default_rng(1)
    actions, advantage = rng.integers(8, size=50), torch.randn(50)
    now = logits.log_softmax(dim=-1)
    before = now.detach()[torch.arange(50), torch.from_numpy(actions)]
    values, targets = torch.zeros(50), np.zeros(50, dtype=np.float32)
    loss, _ = clipped_loss(config, 0.0, now, actions, before, advantage, values, targets)
    (found,) = torch.autograd.grad(loss, logits, retain_graph=True)
    by_hand = -(now[torch.arange(50), torch.from_numpy(actions)] * advantage).mean()
    (expected,) = torch.autograd.grad(by_hand, logits)
    torch.testing.assert_close(found, expected)


def test_drawn_actions_have_the_probabilities():
    rng = np.random.default_rng(0)
    probabilities = rng.dirichlet(np.ones(8)).astype(np.float32)
    drawn = sample_actions(
        np.tile(probabilities, (40_000, 1)), rng.random(40_000, dtype=np.float32)
    )
    np.testing.assert_allclose(np.bincount(drawn, minlength=8) / 40_000, probabilities, atol=0.01)


def trap() -> SceneSet:
    """A dead end on the straight way to the goal, whose end cannot be seen from its entrance."""
    feasible = np.ones((16, 9), dtype=bool)
    feasible[4:13, 2] = feasible[4:13, 6] = feasible[12, 2:7] = False
    return one_room(feasible, (1, 4), (15, 4))


@pytest.mark.parametrize(("known_extra", "below"), [(0.0, 1.0 + 1e-6), (KNOWN_EXTRA, 1.1)])
def test_explorer_learns_by_ppo_alone_to_keep_out_of_a_dead_end(monkeypatch, known_extra, below):
    """By the shortest way, where it has nothing to prefer among known cells."""
    monkeypatch.setattr("agents.networks.explorer.KNOWN_EXTRA", known_extra)
    pool = trap()
    config = ExplorerPpoConfig(
        robots=16,
        n_plans=4,
        patch_radius=2,
        random_start=0.7,
        total_timesteps=16_000,
        learning_rate=1e-3,
        vf_coef=0.2,
    )
    torch.manual_seed(0)
    teacher, taken = ExplorerPpo(config, first_network(config), np.random.default_rng(0)), 0
    env = env_of(pool, observation="flat", patch_radius=2)

    def episode():
        return roll_out(Explorer(network_settings(config), teacher.network, pool.shape), env)

    assert episode().ratio > 1.8
    teacher.network.train()
    while taken < config.total_timesteps:
        steps, _ = teacher.update(pool, taken / config.total_timesteps)
        taken += steps
    assert episode().ratio < below


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robots": 0}, "robots=0 must be a positive integer"),
        ({"random_start": 1.5}, "random_start=1.5 must be a number from 0 to 1"),
        ({"guess_coef": -1.0}, "guess_coef=-1.0 must not be negative"),
    ],
)
def test_bad_settings_of_an_explorer_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        replace(ExplorerConfig(), **change)


def test_bad_random_start_of_an_algorithm_of_sb3_is_refused():
    with pytest.raises(ValueError, match="random_start=2"):
        LocalPpoConfig(random_start=2)


def test_local_features_tell_feasible_cells_and_the_way_to_the_goal():
    env = env_of(POOL, observation="flat", patch_radius=1)
    seen, _ = env.reset(options={"scene_id": 2})
    extractor = LocalExtractor(env.observation_space)
    features = extractor(torch.from_numpy(seen)[None])[0].numpy()
    assert features.shape == (extractor.features_dim,)
    np.testing.assert_array_equal(features[: len(seen)], seen)
    np.testing.assert_array_equal(features[len(seen) : len(seen) + 9], seen[:9] >= 0)
    offset = (POOL.goal[2] - POOL.start[2]) / POOL.shape * FRAME
    np.testing.assert_allclose(
        features[len(seen) + 9 :][:2], offset / np.linalg.norm(offset), rtol=1e-5
    )
    np.testing.assert_allclose(features[-2:], offset / 40.0, rtol=1e-5)
