"""Facts of `python -m eval animate`: a frame for each step, in the colours of the pictures."""

from io import BytesIO
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from PIL import Image
from stable_baselines3 import PPO

from agents.policies.heuristics import oracle
from agents.rollout.episode import arguments_of
from agents.runs.manifest import Config
from agents.runs.run_folder import Run
from eval.animation import LAST_MS, as_gif, film
from eval.commands.animate import main
from eval.load_policy import LoadedPolicy, Place
from irs_gym.mdp.task import Task

CLOSE = Task(
    observation="flat",
    patch_radius=1,
    irs_phases=False,
    target_db=-62.2,
    start=(30, 22),
    goal=(33, 20),
)


def frames_of(content: bytes) -> list[np.ndarray]:
    with Image.open(BytesIO(content)) as picture:
        frames = []
        for n in range(picture.n_frames):
            picture.seek(n)
            frames.append(np.asarray(picture.convert("RGB")))
        return frames


def test_film_has_the_picture_before_any_move_and_one_for_each_step():
    env = gymnasium.make("irs_gym:IrsNav-v0", render_mode="rgb_array", **arguments_of(CLOSE))
    frames, summary = film(LoadedPolicy(oracle(env), env))
    steps = len(env.unwrapped.path) - 1
    assert len(frames) == 1 + steps > 3
    assert "reached the goal after" in summary
    env.reset()
    np.testing.assert_array_equal(frames[0], env.render())
    assert all((a != b).any() for a, b in pairwise(frames))


def test_gif_holds_every_frame_in_its_colours_and_holds_the_last():
    env = gymnasium.make("irs_gym:IrsNav-v0", render_mode="rgb_array", **arguments_of(CLOSE))
    frames, _ = film(LoadedPolicy(oracle(env), env))
    content = as_gif(frames, fps=20)
    for ours, theirs in zip(frames_of(content), frames, strict=True):
        assert np.abs(ours.astype(int) - theirs).mean() < 2
    with Image.open(BytesIO(content)) as picture:
        assert picture.info["duration"] == 50
        picture.seek(len(frames) - 1)
        assert picture.info["duration"] == LAST_MS


def test_command_writes_a_reference_policys_episode(tmp_path, capsys):
    assert main("oracle", Place(target_db=-63.0), out=tmp_path / "oracle.gif") == 0
    assert "reached the goal after 21.571 m, the oracle needs 21.571 m" in capsys.readouterr().out
    assert len(frames_of((tmp_path / "oracle.gif").read_bytes())) > 20


def test_command_writes_an_episode_of_a_run_into_its_folder(tmp_path, capsys):
    env = gymnasium.make("irs_gym:IrsNav-v0", **arguments_of(CLOSE))
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=8,
        batch_size=8,
        policy_kwargs={"net_arch": [8]},
        device="cpu",
        seed=0,
    )
    config = Config(
        algorithm="ppo", seed=0, env=arguments_of(CLOSE), agent={"net_arch": [8]}, training={}
    )
    run = Run.create(tmp_path / "run", config)
    run.save_model("best", model, 0, is_success=False, ratio=None)
    assert main(str(run.folder)) == 0
    assert str(run.folder / "animation.gif") in capsys.readouterr().out
    assert len(frames_of((run.folder / "animation.gif").read_bytes())) > 1
    assert main(str(run.folder), Place(target_db=-63.0)) == 2
    assert "target_db cannot be given along with a run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("policy", "settings", "message"),
    [
        ("nowhere", {}, "'nowhere' is neither a run folder nor one of ppo"),
        ("oracle", {"fps": 0}, "fps=0 must be"),
        ("oracle", {"place": Place(target_db=-20.0)}, "highest feasible target"),
        ("oracle", {"place": Place(scene="nowhere.json")}, "nowhere.json"),
    ],
)
def test_mistakes_are_told_in_a_line(policy, settings, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(policy, **settings) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
