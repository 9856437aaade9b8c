"""Facts of what explorers make of a map: exact prices, the same in any batch and precision, and the
first of the best moves.
"""

from copy import deepcopy

import gymnasium
import numpy as np
import pytest
import torch
from tiny_pool import tiny_pool
from torch.nn.functional import conv2d, pixel_shuffle, pixel_unshuffle

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
    dijkstra_search,
    value_iteration,
    value_iteration_over_cells,
)
from agents.policies.explorer_policy import Explorer, decode_local


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


def test_a_search_for_one_cell_of_each_map_is_exact_as_far_as_from_there():
    rng = torch.Generator().manual_seed(1)
    cost = 1.0 + torch.rand((12, 30, 30), generator=rng)
    cost[torch.rand(cost.shape, generator=rng) < 0.3] = 1e6
    goals = torch.randint(900, (12,), generator=rng)
    is_goal = torch.nn.functional.one_hot(goals, 900).bool().view(12, 30, 30)
    moves = costs_of_moves(cost)
    whole = value_iteration(moves, is_goal)
    np.testing.assert_allclose(whole, dijkstra_search(moves, is_goal).float(), rtol=1e-5)
    for cells in (goals, (goals + 35) % 900, torch.randint(900, (12,), generator=rng)):
        found = value_iteration_over_cells(cost, is_goal, cells)
        reach = whole.flatten(1).gather(1, cells[:, None])[..., None]
        is_near = whole <= reach
        assert torch.equal(found[is_near], whole[is_near])
        assert (found >= whole).all()
    early = value_iteration_over_cells(cost, is_goal, goals)
    assert not torch.equal(early, whole)  # it ended sooner


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
