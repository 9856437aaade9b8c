"""Facts of what explorers make of a map: exact prices, the same in any batch and precision, and the
first of the best moves.
"""

from copy import deepcopy

import gymnasium
import numpy as np
import pytest
import torch
from tiny_pool import tiny_pool
from torch.nn.functional import conv2d, pad, pixel_shuffle, pixel_unshuffle

from agents.networks.explorer import (
    LEAST_EXTRA,
    MOST_EXTRA,
    ExplorerNetwork,
    _of_blocks,
    costs_of_moves,
)
from agents.networks.map_network import (
    NetworkFileError,
    first_of_best,
    pack_network,
    unpack_network,
)
from agents.networks.planner import (
    UNREACHED,
    dijkstra_search,
    neighbours,
    value_iteration,
)
from agents.policies.explorer_policy import Explorer, decode_local
from agents.policies.path_plan import OFF_PATH, are_cut_off, plan_paths


def learned(width: int) -> ExplorerNetwork:
    """With weights as large as learning makes them, and beyond."""
    torch.manual_seed(width)
    network = ExplorerNetwork(width)
    with torch.no_grad():
        for weight in network.parameters():
            weight.add_(torch.randn(weight.shape) * 0.2)
    return network.eval()


def seen_in_part(number: int, shape: tuple[int, int], seed: int = 0):
    """Margins, of which the cells around a few places were seen, and goals."""
    rng = torch.Generator().manual_seed(seed)
    margin = torch.rand((number, *shape), generator=rng) * 2.0 - 0.6
    unknown = torch.rand((number, *shape), generator=rng) < 0.6
    goals = torch.randint(shape[0] * shape[1], (number,), generator=rng)
    return margin.clamp(-1, 1).masked_fill(unknown, torch.nan), goals


@pytest.mark.parametrize("width", [8, 16, 64])
@pytest.mark.parametrize("shape", [(9, 7), (40, 40), (24, 17)])
def test_prices_are_exact_in_any_batch_and_precision(width, shape):
    network = learned(width)
    margin, goals = seen_in_part(19, shape)
    with torch.inference_mode():
        found = network.prices(margin, goals)
        alone = [network.prices(margin[n : n + 1], goals[n : n + 1]) for n in range(len(goals))]
        finer = deepcopy(network).double().prices(margin.double(), goals)
    for n, each in enumerate(alone):
        assert torch.equal(each.cost[0], found.cost[n])
        assert torch.equal(each.feasible[0], found.feasible[n])
    # double precision has twice the digits: nothing was rounded in single precision
    assert torch.equal(finer.feasible, found.feasible.double())
    assert torch.equal(finer.cost.float(), found.cost)
    unknown = found.cost[margin.isnan()]
    assert unknown.unique().numel() > 20
    assert unknown.min() >= 1.0 + LEAST_EXTRA
    assert unknown.max() <= 1.0 + MOST_EXTRA


def test_rounded_prices_are_near_those_that_were_learned():
    torch.manual_seed(0)
    network = ExplorerNetwork()
    torch.nn.init.normal_(network.answer.weight, std=0.1)
    margin, goals = seen_in_part(8, (40, 40))
    with torch.inference_mode():
        exact = network.eval().prices(margin, goals).cost
        learned_ = network.train().prices(margin, goals).cost
    assert not torch.equal(exact, learned_)
    np.testing.assert_allclose(exact, learned_, atol=0.05)


def test_a_kernel_of_blocks_does_what_that_of_cells_does():
    """A checkerboard of prices, which makes diagonal moves cheap, cannot be learned."""
    rng = torch.Generator().manual_seed(0)
    kernel = torch.randn((3, 5, 3, 3), generator=rng)
    cells = torch.randn((2, 5, 12, 8), generator=rng)
    expected = conv2d(cells, kernel, padding=1)
    found = conv2d(pixel_unshuffle(cells, 2), _of_blocks(kernel), padding=1)
    torch.testing.assert_close(pixel_shuffle(found, 2), expected)


def test_where_nothing_was_seen_no_cell_costs_less_for_its_place_in_a_block():
    network = learned(16)
    with torch.no_grad():
        network.first.weight.view(16, 8, 4, 3, 3)[:, 6:] = 0.0  # the direction of the goal
        network.answer.weight[:, -2:] = 0.0
    margin = torch.full((1, 120, 120), torch.nan)
    with torch.inference_mode():
        cost = network.prices(margin, torch.tensor([0])).cost[0]
    inner = cost[52:68, 52:68]  # as far from the border and the goal as it can see
    assert (inner == inner[0, 0]).all()
    assert not (cost == inner[0, 0]).all()


def test_cells_around_a_map_change_no_price():
    network = learned(8)
    margin, goals = seen_in_part(3, (12, 9))
    with torch.inference_mode():
        found = network.prices(margin, goals).cost
        odd = network.prices(margin[:, :11], goals.clamp(max=11 * 9 - 1)).cost
    assert found.shape == (3, 12, 9)
    assert odd.shape == (3, 11, 9)
    assert found.isfinite().all()


@pytest.mark.parametrize("closed", [0.3, 0.9])
def test_a_path_takes_the_moves_of_value_iteration(closed):
    """To the last digit of single precision, through walls as well where it must."""
    rng = torch.Generator().manual_seed(1)
    cost = 1.0 + torch.rand((12, 30, 30), generator=rng)
    cost[torch.rand(cost.shape, generator=rng) < closed] = 1e6
    starts, goals = torch.randint(900, (2, 12), generator=rng)
    is_goal = torch.nn.functional.one_hot(goals, 900).bool().view(12, 30, 30)
    costs = costs_of_moves(cost)
    to_go = value_iteration(costs, is_goal)
    np.testing.assert_allclose(to_go, dijkstra_search(costs, is_goal).float(), rtol=1e-5)
    ahead = neighbours(pad(to_go, (1, 1, 1, 1), value=UNREACHED))
    expected = (costs + torch.stack(ahead, dim=1)).flatten(2).numpy().argmin(axis=1)  # (12, 900)
    moves = plan_paths(cost.numpy(), starts.numpy(), goals.numpy())
    is_path = moves >= 0
    np.testing.assert_array_equal(moves[is_path], expected[is_path])
    assert is_path[np.arange(12), starts].all()
    assert is_path.sum() > 12 * 5


def test_costs_that_are_no_numbers_lead_nowhere():
    for shape in ((1, 1), (1, 5), (5, 5)):
        cost = np.full((1, *shape), np.nan, dtype=np.float32)
        moves = plan_paths(cost, np.array([0]), np.array([cost.size - 1]))
        assert moves[0, 0] == 0
        assert (moves[0, 1:] < 0).all()


def test_moves_that_are_worse_by_no_more_than_a_tie_are_taken_first():
    cost = np.ones((1, 3, 3), dtype=np.float32)
    cost[0, 1, 0] = 1.001  # east of the start, which is not the shortest way to the northeast
    to = np.array([1 * 3 + 1])
    assert plan_paths(cost, np.array([0]), to, tie=0.0)[0, 0] == 1
    assert plan_paths(cost, np.array([0]), to, tie=1.0)[0, 0] == 0


def test_a_path_is_cut_off_by_what_is_closed_before_it_leaves_the_view():
    moves = np.full((4, 9, 9), OFF_PATH, dtype=np.int8)
    moves[:, 1:6, 4] = 0  # east, from (1, 4) to the goal at (6, 4)
    cells = np.full(4, 3 * 9 + 4)
    is_closed = np.zeros((4, 5, 5), dtype=bool)  # (3, 4) is in the middle
    is_closed[0, 4, 2] = True  # (5, 4)
    is_closed[1, 0, 2] = True  # (1, 4), which it has left behind
    is_closed[2, 3, 3] = True  # (4, 5), beside the path
    moves[3] = OFF_PATH
    is_closed[3] = True
    assert are_cut_off(moves, cells, is_closed).tolist() == [True, False, False, False]


def test_a_path_is_not_cut_off_by_what_is_closed_behind_its_goal():
    cost = np.ones((1, 9, 9), dtype=np.float32)
    start, goal = 1 * 9 + 4, 4 * 9 + 4
    moves = plan_paths(cost, np.array([start]), np.array([goal])).reshape(1, 9, 9)
    is_closed = np.ones((1, 11, 11), dtype=bool)  # the start is in the middle
    is_closed[0, 5:9, 5] = False  # all but the path
    assert not are_cut_off(moves, np.array([start]), is_closed).any()
    is_closed[0, 8, 5] = True  # the goal itself
    assert are_cut_off(moves, np.array([start]), is_closed).all()


def test_a_robot_takes_the_first_of_the_best_moves_of_its_plan():
    pool = tiny_pool(6, (9, 7))
    policy = Explorer({"width": 8}, learned(8), pool.shape)
    env = gymnasium.make_vec(
        "irs_gym:IrsNavRandom-v0",
        num_envs=6,
        scenes=pool,
        observation="flat",
        patch_radius=2,
        autoreset_mode="SameStep",
    )
    observation, _ = env.reset(seed=3)
    memory, begins = None, np.ones(6, dtype=bool)
    for _ in range(60):
        actions, memory = policy.predict(observation, memory, begins)
        at = decode_local(observation, pool.shape).cell.ravel()
        with torch.inference_mode():
            margin = torch.from_numpy(np.ascontiguousarray(memory.belief.maps))
            plan = policy.network.eval()(margin, torch.from_numpy(memory.goals)).plan
        best = first_of_best(plan.logits.flatten(2).numpy(), axis=1)  # (6, X * Y)
        assert actions.tolist() == best[np.arange(6), at].tolist()
        observation, _, terminated, truncated, _ = env.step(actions)
        begins = terminated | truncated


def test_a_file_of_an_explorer_of_old_is_refused_in_words():
    network = ExplorerNetwork(8)
    network.read_out = torch.nn.Conv2d(8, 12, 1)
    with pytest.raises(NetworkFileError, match="which read out each place in a block by itself"):
        unpack_network(pack_network("explorer", {"width": 8}, network))
    network.layers.extend(torch.nn.Conv2d(8, 8, 3) for _ in range(2))
    with pytest.raises(NetworkFileError, match="an explorer of old, which saw each cell by itself"):
        unpack_network(pack_network("explorer", {"width": 8}, network))
