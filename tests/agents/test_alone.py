"""Facts of episodes that depend on nothing but their scene: neither on a batch nor on what else is
in a folder.
"""

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from agents.networks.map_network import TIE, first_of_best, plan_alone
from agents.policies.replanning import Replanner
from agents.rollout.episode import roll_out
from agents.rollout.scene_set import play_scene_set
from agents.runs.pretrained import load_pretrained
from irs_gym.datasets.generator import Difficulty, generate_scene
from irs_gym.datasets.scene_set import frame_of, scene_set_of
from irs_gym.datasets.splits import scene_of

SMALL = [
    generate_scene(np.random.default_rng(n), Difficulty(sides=(8.0, 11.0), boxes=(2, 5)))
    for n in range(4)
]
SCENES = [
    *(scene.model_copy(update={"name": f"small-{n}"}) for n, scene in enumerate(SMALL)),
    *(scene_of("test", n) for n in range(4)),
    *(scene_of(f"train-{name}", 0) for name in ("spiral", "trap", "doors", "hall")),
]
LARGE = generate_scene(
    np.random.default_rng(0), Difficulty(sides=(50.0, 50.0), boxes=(60, 60), detour_share=0.0)
)
ALONE = [scene_set_of([scene]) for scene in SCENES]
TOGETHER = scene_set_of(SCENES)
AMONG_LARGER = scene_set_of([LARGE, *SCENES[::-1]])
KINDS = ("planner", "planner_ppo", "unet", "unet_ppo", "explorer", "explorer_ppo", "replanning")


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_is_the_same_alone_and_among_others_of_any_size(kind):
    policy = Replanner((40, 40), 5) if kind == "replanning" else load_pretrained(kind).policy
    alone = np.concatenate([play_scene_set(policy, pool).distance for pool in ALONE])
    assert play_scene_set(policy, TOGETHER).distance.tolist() == alone.tolist()
    if not kind.endswith("_ppo"):  # an explorer takes seconds
        among = play_scene_set(policy, AMONG_LARGER).distance
        assert among[:0:-1].tolist() == alone.tolist()


def test_an_agent_of_stable_baselines_plays_alone_as_among_others():
    torch.manual_seed(0)
    env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=TOGETHER, observation="flat")
    policy = PPO("MlpPolicy", env, n_steps=8, batch_size=8).policy
    alone = [play_scene_set(policy, pool, max_steps=60).distance[0] for pool in ALONE[::3]]
    assert play_scene_set(policy, TOGETHER, max_steps=60).distance[::3].tolist() == alone


@pytest.mark.parametrize("kind", ["planner", "unet"])
def test_a_map_policy_acts_in_the_environment_as_it_is_scored_whatever_the_frame(kind):
    policy = load_pretrained(kind).policy
    scored = play_scene_set(policy, TOGETHER)
    env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=AMONG_LARGER, observation="map")
    for n in (0, 3, 5, 11):
        episode = roll_out(policy, env, options={"scene_id": len(SCENES) - n})
        assert episode.distance == pytest.approx(scored.distance[n])


def test_frames_are_those_of_the_rooms_own_size():
    assert [frame_of(each) for each in ((9, 7), (40, 40), (41, 40), (64, 24))] == [
        *((40, 40), (40, 40), (80, 40), (80, 40))
    ]
    found = {names: pool.shape for numbers, pool in AMONG_LARGER.by_frame() for names in pool.names}
    assert found["generated"] == (120, 120)
    assert found["small-0"] == found["test-0"] == (40, 40)
    numbers = np.concatenate([numbers for numbers, _ in AMONG_LARGER.by_frame()])
    assert sorted(numbers.tolist()) == list(range(len(AMONG_LARGER)))
    for numbers, pool in AMONG_LARGER.by_frame():
        assert pool.oracle_distance.tolist() == AMONG_LARGER.oracle_distance[numbers].tolist()
        assert pool.feasible.sum() == AMONG_LARGER.feasible[numbers].sum()


def test_blocked_cells_around_a_map_change_no_logit():
    network = load_pretrained("unet").policy.network
    maps = np.zeros((3, 30, 33), dtype=np.float32)
    maps[2, 5, 5] = 1.0
    wide = np.zeros((3, 90, 41), dtype=np.float32)
    wide[0] = -1.0
    wide[1] = 1.0
    wide[:, :30, :33] = maps
    np.testing.assert_array_equal(plan_alone(network, maps), plan_alone(network, wide)[:, :30, :33])


def test_of_logits_as_good_as_equal_the_first_is_taken():
    logits = np.array([[0.0, 1.0, 1.0 + TIE / 2, 0.5], [0.0, 1.0, 1.0 + 2 * TIE, 0.5]])
    assert first_of_best(logits, axis=1).tolist() == [1, 2]
