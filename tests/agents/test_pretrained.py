"""Facts of pretrained models: they do what their manifest says, and nothing else is loaded in their
place.
"""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import torch
from evaluating import call
from PIL import Image

from agents.registry import learner_class
from agents.rollout.episode import arguments_of, evaluation_env, roll_out
from agents.rollout.scene_set import play_scene_set
from agents.runs.manifest import Config
from agents.runs.pretrained import (
    MODELS,
    Models,
    PretrainedEntry,
    PretrainedError,
    PretrainedScore,
    load_pretrained,
    write_models,
)
from agents.runs.problem import problem_of
from agents.runs.run_folder import Run
from agents.vec_env import IrsNavVecEnv
from eval.commands.watch import fit
from irs_gym import RadioMap, load_scene
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.mdp.task import Task

ROOT = Path(__file__).resolve().parents[2]
TASK = Task(observation="flat", patch_radius=1, irs_phases=False, random_start=0.7)
ENTRIES = Models.read(MODELS).models


@pytest.fixture
def models(tmp_path) -> Path:
    """A copy of models/, to be damaged."""
    return Path(shutil.copytree(MODELS, tmp_path / "models"))


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.file)
def test_model_scores_what_its_manifest_says(entry):
    given = {
        name: getattr(entry.task, name) for name in ("target_db", "phase_bits", "irs_elements")
    }
    pretrained = load_pretrained(entry.config.algorithm, **given)
    assert pretrained.entry == entry
    assert PretrainedScore.of(pretrained.play()) == entry.score
    assert entry.score.oracle_distance == pytest.approx(
        pretrained.make_env().unwrapped.oracle.distance, abs=1e-9
    )
    assert (MODELS / entry.file).stat().st_size < 600_000


def test_every_model_of_one_task_takes_a_shortest_path():
    assert {(entry.score.is_success, round(entry.score.ratio, 9)) for entry in ENTRIES} == {
        (True, 1.0)
    }


def test_a_pretrained_ppo_draws_its_moves_unless_it_is_asked_for_the_likeliest():
    model = load_pretrained("ppo", target_db=-61.8)
    observation, _ = model.make_env().reset(seed=0)
    observations = np.repeat(observation[None], 500, axis=0)
    torch.manual_seed(0)
    assert len(set(model.predict(observations)[0].tolist())) > 1
    assert len(set(model.predict(observations, deterministic=True)[0].tolist())) == 1


def test_package_hands_out_the_loader_without_importing_torch():
    code = "import agents, sys; assert 'torch' not in sys.modules; print(agents.load_pretrained.__name__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "load_pretrained"


def test_file_with_another_hash_is_refused(models):
    path = models / ENTRIES[0].file
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    task = ENTRIES[0].task
    with pytest.raises(PretrainedError, match="is not loaded: its SHA-256 is"):
        load_pretrained(ENTRIES[0].config.algorithm, folder=models, **arguments_of(task))


def test_lost_file_is_named(models):
    (models / ENTRIES[0].file).unlink()
    with pytest.raises(OSError, match=ENTRIES[0].file):
        load_pretrained(ENTRIES[0].config.algorithm, folder=models, **arguments_of(ENTRIES[0].task))


def test_pickle_in_place_of_weights_is_never_run(models):
    path = models / ENTRIES[0].file
    np.savez(path, evil=np.array([{"a": 1}], dtype=object))
    record = json.loads((models / "manifest.json").read_text())
    record["models"][0]["sha256"] = sha256(path.read_bytes()).hexdigest()
    (models / "manifest.json").write_text(json.dumps(record))
    with pytest.raises(PretrainedError, match="holds objects, which would have to be unpickled"):
        load_pretrained(ENTRIES[0].config.algorithm, folder=models, **arguments_of(ENTRIES[0].task))


def test_what_there_is_not_is_answered_with_what_there_is():
    with pytest.raises(PretrainedError) as refused:
        load_pretrained("ppo", target_db=-70.25)
    said = str(refused.value)
    assert "no pretrained 'ppo' for -70.25 dB, continuous" in said
    assert all(f"{each.config.algorithm}: {each.problem.label}" in said for each in ENTRIES)


def test_model_of_another_observation_is_refused():
    assert (
        load_pretrained("ppo", target_db=-61.8, observation="flat").entry.task.observation == "flat"
    )
    with pytest.raises(PretrainedError, match="observation='flat', not 'dict'"):
        load_pretrained("ppo", target_db=-61.8, observation="dict")
    with pytest.raises(TypeError, match="got an unexpected keyword argument 'targets'"):
        load_pretrained("ppo", targets=-61.8)


@pytest.mark.parametrize(
    "damage", ['{"format_version": 1, "models": [{}]}', '{"mo', '{"format_version": 2}']
)
def test_damaged_manifest_is_named(models, damage):
    (models / "manifest.json").write_text(damage)
    with pytest.raises(PretrainedError, match=r"manifest\.json' is damaged"):
        load_pretrained("ppo", folder=models)


def save_run(
    folder: Path, algorithm: str, seed: int, task: Task = TASK, *, east=False, steps=100, **settings
) -> Run:
    """A complete run of an agent that has learned nothing, or to go east, after so many steps."""
    config = Config(
        algorithm=algorithm, seed=seed, env=arguments_of(task), agent=settings, training={}
    )
    run = Run.create(folder, config)
    env = IrsNavVecEnv(2, **arguments_of(run.task))
    model = learner_class(algorithm)(
        "MlpPolicy", env, policy_kwargs=dict(settings), seed=seed, device="cpu"
    )
    if east:
        model.policy.action_net.bias.data[0] += 100.0
    episode = roll_out(model, evaluation_env(run.task))
    run.save_model("best", model, steps, is_success=episode.is_success, ratio=episode.ratio)
    run.write_curve([{"steps": steps, "seconds": 1.0, "ratio": episode.ratio, "spl": episode.spl}])
    run.update(status="finished")
    return run


@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [
        ("ppo", {"net_arch": [8, 4]}),
        ("maskable_ppo", {"net_arch": [8]}),
        ("dqn", {"net_arch": [8]}),
        ("qr_dqn", {"net_arch": [8], "n_quantiles": 5}),
    ],
)
def test_kept_policy_acts_as_the_one_that_was_trained(tmp_path, algorithm, settings):
    run = save_run(tmp_path / "run", algorithm, 3, **settings)
    model = run.load_model()
    content = run.read_model()
    score = PretrainedScore.of(roll_out(model, evaluation_env(TASK)))
    entry = PretrainedEntry(
        file="it.npz", sha256=sha256(content).hexdigest(), config=run.config, steps=1, chosen_among=1, score=score,
        versions={}, commit=None,
    )  # fmt: skip
    write_models(tmp_path / "models", [entry], {"it.npz": content})
    kept = load_pretrained(algorithm, folder=tmp_path / "models")
    assert PretrainedScore.of(kept.play()) == score
    observations = np.random.default_rng(0).uniform(
        -1, 1, (500, *kept.policy.observation_space.shape)
    )
    actions, _ = kept.predict(observations.astype(np.float32), deterministic=True)
    assert np.array_equal(
        actions, model.predict(observations.astype(np.float32), deterministic=True)[0]
    )
    assert len(set(actions.tolist())) > 1
    wrong = entry.model_copy(
        update={"config": run.config.model_copy(update={"agent": {"net_arch": [3]}})}
    )
    write_models(tmp_path / "models", [wrong], {})
    with pytest.raises(PretrainedError, match="does not fit its configuration"):
        load_pretrained(algorithm, folder=tmp_path / "models")


def test_best_run_of_each_problem_is_kept(monkeypatch, capsys, tmp_path):
    near = replace(TASK, goal=(2, 20))  # two moves to the east
    for seed, steps in enumerate([50, 300, 200]):
        save_run(
            tmp_path / f"runs/{seed}", "ppo", seed, near, east=seed > 0, steps=steps, net_arch=[8]
        )
    (tmp_path / "runs/broken").mkdir()
    (tmp_path / "runs/broken/config.json").write_text("{}")
    assert call(monkeypatch, "pretrain", tmp_path / "runs", "--out", tmp_path / "models") == 0
    assert "broken" in capsys.readouterr().err
    (entry,) = Models.read(tmp_path / "models").models
    assert (entry.config.seed, entry.chosen_among, entry.score.ratio, entry.steps) == (
        2,
        3,
        1.0,
        200,
    )
    # Models of other problems stay when more are kept, and one of the same is replaced.
    other = replace(near, target_db=-63.0)
    save_run(tmp_path / "more/0", "ppo", 0, other, east=True, net_arch=[8])
    assert call(monkeypatch, "pretrain", tmp_path / "more", "--out", tmp_path / "models") == 0
    assert call(monkeypatch, "pretrain", tmp_path / "more", "--out", tmp_path / "models") == 0
    assert [each.problem.target_db for each in Models.read(tmp_path / "models").models] == [
        -63.0,
        -61.8,
    ]


def test_nothing_is_kept_of_runs_that_failed(monkeypatch, capsys, tmp_path):
    save_run(tmp_path / "runs/0", "ppo", 0, net_arch=[8])
    assert call(monkeypatch, "pretrain", tmp_path / "runs", "--out", tmp_path / "models") == 2
    assert "reached the goal" in capsys.readouterr().err
    assert (
        call(monkeypatch, "pretrain", tmp_path / "runs", "--algorithms", "q_learning") == 2
    )  # it has no network
    assert not (tmp_path / "models").exists()


def test_problems_are_equal_where_their_optimum_is(tmp_path):
    same = [
        Task(),
        Task(irs_elements=1200),
        Task(quantiser="optimal"),
        Task(random_start=True, observation="map"),
    ]
    assert len({problem_of(task) for task in same}) == 1
    load_scene("paper").save(tmp_path / "copy.json")
    assert problem_of(Task(scene=tmp_path / "copy.json")) == problem_of(Task())
    mine = load_scene("paper").model_copy(update={"start": (-10.0, 5.0)})
    gains = [RadioMap.from_array(np.full((2, 2), gain), 1.0) for gain in (0.0, 1.0)]
    others = [
        Task(target_db=-61.80001),
        Task(phase_bits=1),
        Task(phase_bits=1, quantiser="optimal"),
        Task(irs_elements=600),
        Task(irs_elements=0),
        Task(constraint="allow"),
        Task(scene=mine),
        Task(goal=(3, 3)),
        *(Task(radio_map=each, start=(0, 0), goal=(1, 1)) for each in gains),
    ]
    problems = [problem_of(task) for task in [Task(), *others]]
    for names in (problems, [each.label for each in problems], [each.slug for each in problems]):
        assert len(set(names)) == len(problems)
    assert problem_of(Task(irs_elements=0, phase_bits=1)) == problem_of(
        Task(irs_elements=0, quantiser="optimal")
    )
    assert problem_of(Task(phase_bits=1)).label == "-61.8 dB, 1 bit"
    assert problem_of(Task(irs_elements=0, target_db=-62.5)).slug == "62.5dB-without-IRS"


def test_policy_is_watched_in_the_terminal_and_as_a_gif(monkeypatch, capsys, tmp_path):
    assert call(monkeypatch, "watch", "ppo") == 0
    said = capsys.readouterr().out
    assert "R|" in said  # the robot is at the goal, by the wall
    assert "reached the goal after 23.228 m" in said
    assert (
        call(monkeypatch, "watch", "oracle", "--target-db", -63, "--gif", tmp_path / "it.gif") == 0
    )
    with Image.open(tmp_path / "it.gif") as film:
        assert film.n_frames > 30
    run = save_run(tmp_path / "run", "ppo", 0, net_arch=[8])
    assert call(monkeypatch, "watch", run.folder) == 0
    assert "did not reach the goal" in capsys.readouterr().out
    assert call(monkeypatch, "watch", run.folder, "--target-db", -63) == 2
    assert "target_db cannot be given along with a run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pop"], "'pop' is neither a run folder nor one of ppo"),
        (["ppo", "--target-db", "-70.25"], "no pretrained 'ppo' for -70.25 dB"),
        (["ppo", "--fps", "0"], "fps=0"),
        (["oracle", "--target-db", "-50"], "infeasible"),
        ([str(MODELS)], "manifest.json' is damaged"),
    ],
)
def test_what_cannot_be_watched_is_told_in_words(monkeypatch, capsys, words, message):
    assert call(monkeypatch, "watch", *words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


def test_high_frame_is_cut_to_the_rows_around_the_robot():
    rows = [f"|{n:02}.{'R' if n == 30 else '.'}|" for n in range(40)]
    frame = "\n".join(["target", *rows, "R robot", "legend"])
    assert fit(frame, 43) == frame
    lines = fit(frame, 13).splitlines()
    assert len(lines) == 13
    assert lines[:1] + lines[-2:] == ["target", "R robot", "legend"]
    assert rows[30] in lines
    assert lines[1:-2] == rows[25:35]
    at_the_top = frame.replace("|30.R|", "|30..|").replace("|00..|", "|00.R|")
    assert fit(at_the_top, 13).splitlines()[1:-2] == ["|00.R|", *rows[1:10]]


GENERALISTS = Models.read(MODELS).generalists


@pytest.mark.parametrize("entry", GENERALISTS, ids=lambda entry: entry.file)
def test_generalist_is_small_and_acts_in_scenes_of_its_own(entry):
    assert (MODELS / entry.file).stat().st_size < 2_000_000
    scene = load_scene("paper").model_copy(update={"target_db": -63.0})
    pretrained = load_pretrained(entry.config.algorithm, scenes=[scene])
    assert pretrained.entry == entry
    episode = roll_out(pretrained, pretrained.make_env())
    assert episode.is_success
    assert episode.ratio < 1.2


def test_generalist_scores_what_its_manifest_says():
    pretrained = load_pretrained("planner")
    env = pretrained.entry.config.env
    episodes = play_scene_set(
        pretrained.policy, build_scene_set(env["test_split"], env["test_scenes"], progress=False)
    )
    assert episodes.is_success.mean() == pretrained.entry.success
    assert episodes.spl.mean() == pytest.approx(pretrained.entry.spl, abs=1e-4)
    assert pretrained.entry.success >= 0.995
