"""Facts of `PlaceExtractor`: its features are sines and cosines of where the robot is, whatever else
is observed, and the same in every run.
"""

from io import BytesIO

import gymnasium
import numpy as np
import pytest
import torch
from tiny import TINY, call, continuous_floor

from agents.networks.place_extractor import WAVES, PlaceExtractor
from agents.registry import drivers
from agents.rollout.episode import evaluation_env
from agents.runs.run_folder import Run
from agents.runs.weights import load
from irs_gym.files import read_arrays

ID = "irs_gym:IrsNavContinuous-v0"
KINDS = [
    {"observation": "flat"},
    {"observation": "flat", "irs_phases": False, "patch_radius": 3},
    {"observation": "dict"},
    {"observation": "flat", "constraint": "budget", "budget": (1.0, 9.0)},
    {"observation": "dict", "constraint": "budget", "budget": (1.0, 9.0)},
]


def seen(kind, start=(-8.0, 3.0)):
    """The space of an environment, and what is observed at a point as a batch of one."""
    env = gymnasium.make(ID, target_db=-63.0, start=start, **kind)
    observation, _ = env.reset(seed=0)
    if isinstance(observation, dict):
        batch = {name: torch.from_numpy(each[None]) for name, each in observation.items()}
        return env.observation_space, batch

    return env.observation_space, torch.from_numpy(observation[None])


@pytest.mark.parametrize("kind", KINDS)
def test_features_are_the_place_the_way_to_the_goal_and_waves_of_the_place(kind):
    space, observation = seen(kind)
    extractor = PlaceExtractor(space)
    features = extractor(observation)[0].double().numpy()
    assert features.shape == (extractor.features_dim,) == (4 + 2 * WAVES,)

    # the paper's room is 20 m wide about the origin, and the goal at (9.75, 0.25)
    place = np.array([-0.8, 0.3])
    assert features[:2] == pytest.approx(place, abs=1e-6)
    assert features[2:4] * 20.0 == pytest.approx(np.array([17.75, -2.75]), abs=1e-4)

    phases = place @ extractor.waves.double().numpy()
    expected = np.concatenate([np.sin(phases), np.cos(phases)])
    assert features[4:] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_the_place_is_read(kind):
    space, observation = seen(kind)
    extractor = PlaceExtractor(space)
    features = extractor(observation)

    if isinstance(observation, dict):
        other = {name: each + (name != "position") for name, each in observation.items()}
    else:
        other = observation.clone()
        other[:, :-4] += 1.0

    assert torch.equal(extractor(other), features)
    assert not torch.equal(extractor(seen(kind, start=(-7.9, 3.0))[1]), features)


def test_inner_products_of_waves_are_a_bell_of_the_distance():
    # of normal waves, of 4 to half a room: exp(-(2 pi 4 d)^2 / 2) at d half rooms (Rahimi and
    # Recht 2007, Theorem 1), here by many more waves than an agent has
    space, _ = seen({"observation": "flat", "patch_radius": 1, "irs_phases": False})
    extractor = PlaceExtractor(space, 4 + 2 * 20_000)
    apart = torch.tensor([0.0, 0.025, 0.05, 0.1])
    places = torch.zeros(4, *space.shape)
    places[:, -4] = apart
    waves = extractor(places)[:, 4:]
    products = waves @ waves[0] / 20_000
    expected = torch.exp(-((8 * torch.pi * apart) ** 2) / 2)
    torch.testing.assert_close(products, expected, atol=0.03, rtol=0.0)


def test_waves_are_the_same_in_every_run_and_draw_nothing_from_the_runs_random_numbers():
    space, _ = seen(KINDS[0])
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first = PlaceExtractor(space)
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(2)
    assert torch.equal(PlaceExtractor(space).waves, first.waves)
    assert not list(first.parameters())


@pytest.mark.parametrize("algorithm", drivers())
def test_waves_are_saved_and_loaded_with_the_model_that_acts_by_them(tmp_path, algorithm):
    words = [*TINY[algorithm], *continuous_floor(tmp_path), "--agent.total-timesteps", 64]
    assert call([algorithm, "--out", tmp_path / "run", *words]) == 0
    run = Run.open(tmp_path / "run")
    arrays = read_arrays(run.read_model("last"))
    names = [name for name in arrays if name.endswith("waves")]
    assert names
    expected = PlaceExtractor(evaluation_env(run.task).observation_space).waves.numpy()
    assert all(np.array_equal(arrays[name], expected) for name in names)

    other = {name: 3.0 * each if name in names else each for name, each in arrays.items()}
    content = BytesIO()
    np.savez(content, **other)
    changed = load(run.config, run.task, content.getvalue())
    policy = run.load_model("last")
    observation = policy.observation_space.sample()
    ours, theirs = (each.predict(observation, deterministic=True)[0] for each in (policy, changed))
    assert not np.array_equal(ours, theirs)
