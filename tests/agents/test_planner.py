"""Facts of the planning network around walls: it goes round them, whatever it has learned."""

from io import BytesIO

import gymnasium
import numpy as np
import pytest
import torch
from tiny_pool import tiny_pool

from agents.networks.map_network import (
    TIE,
    NetworkFileError,
    first_of_best,
    maps_of,
    pack_network,
    plan_scene_set,
    unpack_network,
)
from agents.networks.planner import (
    UNREACHED,
    PlanningNetwork,
    barred_moves,
    dijkstra_search,
    plan,
    value_iteration,
)
from agents.policies.map_policy import MapPolicy
from agents.rollout.scene_set import play_scene_set
from agents.runs.pretrained import load_pretrained
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVES, legal_moves
from irs_gym.mdp.robot import Robot
from irs_gym.oracle.shortest_path import distance_to_go

WALLS_DB = (-1e-3, -30.0, -np.inf)  # below the target by a hair, by far; an obstacle


def pool_of(gain_db, start, goal, cell_size=0.5):
    """A set of maps (S, X, Y) with a target of 0 dB."""
    to_go = np.stack(
        [
            distance_to_go(each >= 0, cell, cell_size)
            for each, cell in zip(gain_db, goal, strict=True)
        ]
    )
    count = len(gain_db)
    names = tuple(f"map-{n}" for n in range(count))
    irs = np.full((count, 3), -1.0, dtype=np.float32)
    return SceneSet(
        (), names, np.zeros(count), gain_db, to_go, irs, np.array(start), np.array(goal), cell_size
    )


def single_wall(detour, wall_db):
    """A wall of one cell with a robot and its goal beside its middle, (180, 24): the way round its
    ends is so many metres longer than the one through it.
    """
    gain_db = np.full((180, 24), 5.0)
    gain_db[: int(detour), 12] = wall_db  # metres of detour are twice the wall's in cells of 0.5 m
    return gain_db


def maze(side, seed, holes=0):
    """A spanning tree of corridors one cell wide, (side, side), by depth-first search."""
    rng = np.random.default_rng(seed)
    is_open = np.zeros((side, side), dtype=bool)
    is_open[0, 0] = True
    stack = [(0, 0)]
    while stack:
        i, j = stack[-1]
        ahead = [
            (di, dj)
            for di, dj in ((2, 0), (-2, 0), (0, 2), (0, -2))
            if 0 <= i + di < side and 0 <= j + dj < side and not is_open[i + di, j + dj]
        ]
        if not ahead:
            stack.pop()
            continue
        di, dj = ahead[rng.integers(len(ahead))]
        is_open[i + di // 2, j + dj // 2] = is_open[i + di, j + dj] = True
        stack.append((i + di, j + dj))
    is_open.flat[rng.choice(np.flatnonzero(~is_open), holes, replace=False)] = True
    return is_open


def network_of(encoding, seed, scale=1.0):
    """A network that has learned anything."""
    torch.manual_seed(seed)
    network = PlanningNetwork(encoding)
    with torch.no_grad():
        for each in network.costs.parameters():
            each.copy_(torch.randn_like(each) * scale)
    return network


def policy_of(network):
    return MapPolicy("planner", {"encoding": network.encoding, "width": 16}, network)


@pytest.mark.parametrize("kind", ["planner", "planner_ppo"])
def test_single_walls_are_gone_round_whatever_the_detour(kind):
    walls = [(metres, db) for metres in (2, 10, 40, 50, 80, 120, 160) for db in WALLS_DB]
    maps = np.stack([single_wall(*each) for each in walls])
    pool = pool_of(maps, [(0, 11)] * len(walls), [(0, 13)] * len(walls))
    assert pool.oracle_distance.max() > 160.0
    episodes = play_scene_set(load_pretrained(kind).policy, pool)
    assert episodes.is_success.all()
    assert episodes.spl.min() > 0.99


@pytest.mark.parametrize("kind", ["planner", "planner_ppo"])
def test_mazes_of_160_cells_are_solved(kind):
    gain_db = np.full((2, 160, 160), -1.0)
    gain_db[:, :159, :159][np.stack([maze(159, 0), maze(159, 1, holes=200)])] = 0.5
    pool = pool_of(gain_db, [(0, 0)] * 2, [(158, 158)] * 2)
    assert pool.oracle_distance.max() > 400.0
    episodes = play_scene_set(load_pretrained(kind).policy, pool, max_steps=20_000)
    assert episodes.is_success.all()
    assert episodes.spl.min() > 0.99


@pytest.mark.parametrize("encoding", ["mask", "margin"])
@pytest.mark.parametrize("scale", [0.3, 30.0])
def test_whatever_was_learned_the_goal_is_reached_and_no_move_refused(encoding, scale):
    pool = tiny_pool(20, (14, 11), seed=3, blocked=0.6)
    network = network_of(encoding, 1, scale)
    moves = first_of_best(plan_scene_set(network, pool), axis=1)
    can_go = np.isfinite(pool.distance_to_go) & (pool.distance_to_go > 0)
    legal = np.take_along_axis(legal_moves(pool.feasible), moves[..., None], axis=-1)[..., 0]
    assert legal[can_go].all()
    episodes = play_scene_set(policy_of(network), pool)
    assert episodes.is_success.all()
    maps = maps_of(pool, np.arange(len(pool)))
    is_barred = barred_moves(maps[:, 0] < 0)
    each_one = torch.ones(len(pool), 8, *pool.shape)
    to_go = plan(each_one, maps[:, 2] > 0, 1.0, dijkstra_search, is_barred).to_go.numpy()
    fewest = to_go[np.arange(len(pool)), pool.start[:, 0], pool.start[:, 1]]
    assert ((episodes.actions >= 0).sum(axis=1) <= 2 * fewest).all()


def test_a_large_robot_is_refused_nothing():
    pool = tiny_pool(20, (18, 18), seed=2, blocked=0.05)
    with pytest.warns(UserWarning, match="cannot be solved by"):
        large = pool.for_robot(Robot(robot_radius=0.4))

    assert large.free.mean() < pool.free.mean()
    episodes = play_scene_set(policy_of(network_of("mask", 0)), large)
    assert episodes.is_success.all()


@pytest.mark.parametrize("wall_db", WALLS_DB)
def test_where_the_goal_cannot_be_reached_all_moves_are_alike(wall_db):
    gain_db = np.full((1, 9, 9), 5.0)
    gain_db[0, 4] = wall_db
    pool = pool_of(gain_db, [(0, 0)], [(8, 8)])
    logits = plan_scene_set(network_of("mask", 0), pool)[0]
    assert (np.ptp(logits[:, :4], axis=0) == 0.0).all()
    assert (np.ptp(logits[:, 5:], axis=0) > TIE).all()


def test_a_robot_in_a_closed_cell_is_led_out_and_never_in_again():
    gain_db = np.full((1, 15, 15), 5.0)
    gain_db[0, 3:12, 3:12] = -3.0
    gain_db[0, 11, 3:12] = -np.inf  # and out on another side than the obstacle's
    pool = pool_of(gain_db, [(7, 7)], [(14, 7)])
    moves = first_of_best(plan_scene_set(network_of("mask", 0), pool), axis=1)[0]
    cells = [(7, 7)]
    while cells[-1] != (14, 7) and len(cells) < 60:
        cells.append(tuple((np.array(cells[-1]) + MOVES[moves[cells[-1]]]).tolist()))
    assert cells[-1] == (14, 7)
    gains = np.array([gain_db[0][cell] for cell in cells])
    assert np.isfinite(gains).all()
    closed = gains < 0
    assert closed[0]
    assert (np.diff(closed.astype(int)) <= 0).all()


def test_both_searches_find_the_same_costs_to_the_last_digit():
    generator = torch.Generator().manual_seed(0)
    costs = 1 + torch.rand(6, 8, 21, 17, generator=generator, dtype=torch.float64)
    is_closed = torch.rand(6, 21, 17, generator=generator) < 0.45
    is_goal = torch.zeros(6, 21, 17, dtype=torch.bool)
    is_goal[:5, 10, 8] = is_goal[2, 0, 0] = True  # the last has none
    found = [
        plan(costs, is_goal, 1.0, search, barred_moves(is_closed))
        for search in (value_iteration, dijkstra_search)
    ]
    assert torch.equal(*(each.to_go for each in found))
    assert torch.equal(*(each.logits for each in found))
    assert 0 < (found[0].to_go == UNREACHED).sum() < found[0].to_go.numel()


def test_costs_to_go_over_thousands_of_moves_are_exact():
    is_open = np.zeros((103, 103), dtype=bool)
    is_open[::2] = True
    is_open[1::4, -1] = is_open[3::4, 0] = True  # a way that winds through the map
    costs = torch.full((1, 8, 103, 103), 1.0 + 2.0**-23, dtype=torch.float64)
    is_goal = torch.zeros(1, 103, 103, dtype=torch.bool)
    is_goal[0, -1, -1] = True
    is_barred = barred_moves(~torch.from_numpy(is_open)[None])
    to_go = plan(costs, is_goal, 1.0, dijkstra_search, is_barred).to_go[0, 0, 0].item()
    moves = round(to_go)
    assert moves > 5000
    assert to_go == moves * (1.0 + 2.0**-23)


@pytest.mark.parametrize("search", [value_iteration, dijkstra_search])
def test_gradient_with_closed_cells_is_that_of_finite_differences(search):
    generator = torch.Generator().manual_seed(4)
    costs = 1 + torch.rand(2, 8, 3, 4, generator=generator, dtype=torch.float64)
    is_closed = torch.rand(2, 3, 4, generator=generator) < 0.4
    is_goal = torch.zeros(2, 3, 4, dtype=torch.bool)
    is_goal[0, 1, 2] = is_goal[1, 2, 3] = True
    is_barred = barred_moves(is_closed & ~is_goal)
    beta = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)
    costs.requires_grad_()
    assert torch.autograd.gradcheck(
        lambda costs, beta: tuple(plan(costs, is_goal, beta, search, is_barred)), (costs, beta)
    )
    plan(costs, is_goal, beta, search, is_barred).to_go.sum().backward()
    assert not costs.grad[is_barred].any()
    assert costs.grad.any()


def test_moves_that_are_barred_are_those_that_the_environment_refuses():
    pool = tiny_pool(4, (9, 7), seed=1, blocked=0.5)
    refused = ~torch.from_numpy(legal_moves(pool.feasible)).permute(0, 3, 1, 2)
    is_closed = ~torch.tensor(pool.feasible)
    assert torch.equal(barred_moves(is_closed), refused)
    own = barred_moves(is_closed, ~torch.tensor(pool.free))
    feasible = ~is_closed[:, None].expand_as(refused)
    assert torch.equal(own[feasible], refused[feasible])
    legal = torch.from_numpy(legal_moves(pool.free)).permute(0, 3, 1, 2)
    assert torch.equal(own[~feasible], ~legal[~feasible])


def test_it_acts_in_the_environment_that_allows_what_the_target_forbids():
    pool = tiny_pool(3, (12, 12), seed=5, blocked=0.4)
    env = gymnasium.make(
        "irs_gym:IrsNavRandom-v0", scenes=pool, observation="map", constraint="allow"
    )
    policy = policy_of(network_of("margin", 0))
    for n in range(3):
        observation, _ = env.reset(options={"scene_id": n})
        is_over = False
        while not is_over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, _, terminated, truncated, info = env.step(int(action))
            is_over = terminated or truncated
        assert info["is_success"]
        assert info["cost"] == 0.0


def test_files_of_the_network_that_paid_for_walls_are_refused():
    torch.manual_seed(0)
    network = PlanningNetwork()
    file = np.load(BytesIO(pack_network("planner", {"encoding": "mask", "width": 16}, network)))
    arrays = {
        name.replace("weight:costs", "weight:log_costs"): file[name]
        if name == "header"
        else file[name].astype(np.float32)
        for name in file.files
    }
    content = BytesIO()
    np.savez_compressed(content, **arrays)
    with pytest.raises(NetworkFileError, match="a planning network of old, which paid for walls"):
        unpack_network(content.getvalue())
