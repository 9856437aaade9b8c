"""Facts of traced prices: they are the network's own to the last digit, and stay so as it learns."""

import torch

from agents.networks.explorer import ExplorerNetwork
from agents.policies.traced_prices import traced_prices


def given(rng: torch.Generator, shape: tuple[int, int]) -> tuple[torch.Tensor, ...]:
    margin = torch.rand((1, *shape), generator=rng) * 2.0 - 1.0
    unknown = torch.rand((1, *shape), generator=rng) < 0.5
    goal = torch.randint(shape[0] * shape[1], (1,), generator=rng)
    return margin.masked_fill(unknown, torch.nan), goal


def test_they_are_the_networks_own_in_maps_of_any_size_and_after_it_has_learned():
    torch.manual_seed(0)
    network = ExplorerNetwork(width=8)
    rng = torch.Generator().manual_seed(0)
    for step in range(3):
        for shape in ((9, 7), (40, 40), (24, 16)):
            for _ in range(3):
                asked = given(rng, shape)
                with torch.inference_mode():
                    for ours, own in zip(
                        traced_prices(network, asked), network.prices(*asked), strict=True
                    ):
                        assert torch.equal(ours, own), (step, shape)
        with torch.no_grad():
            for weight in network.parameters():
                weight.add_(torch.randn(weight.shape, generator=rng), alpha=0.1)
