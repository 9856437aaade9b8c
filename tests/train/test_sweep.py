"""Facts of sweeps: what they train, what they refuse, and that no run is lost to a failure or to a
kill.
"""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
import ray
from tiny import TINY, call, curve, numbers

from agents.learning.local_configs import ExplorerConfig
from agents.registry import generalists, specialists
from agents.runs.run_folder import LockedError, Run
from irs_gym.datasets.splits import FAMILIES, all_but, members_of
from irs_gym.mdp.task import build_world
from train import resume
from train.config import defaults_of, parse, record_of
from train.plan import Plan, PlanError
from train.sweep import Sweep

ROOT = Path(__file__).resolve().parents[2]
SWEEPS = ROOT / "train/sweeps"

SMALL = """
seeds = {seeds}
algorithms = ["q_learning"]
out = "{out}"

[settings.short]
agent = {{ total_timesteps = {steps}, n_envs = 4 }}
env = {{ patch_radius = 1 }}
training = {{ eval_every = 64, checkpoint_every = 96 }}
"""


def write(folder: Path, *, seeds: int = 2, steps: int = 320, more: str = "") -> Path:
    file = folder / "sweep.toml"
    file.write_text(SMALL.format(out=folder / "runs", seeds=seeds, steps=steps) + more)
    return file


def load(folder: Path, text: str) -> Plan:
    (folder / "sweep.toml").write_text(text)
    return Plan.load(folder / "sweep.toml")


def test_plan_is_the_product_of_algorithms_settings_and_seeds(tmp_path):
    text = """
    out = "runs"
    seeds = 2
    algorithms = ["ppo", "dqn"]
    settings.low.env = { target_db = -62.5 }
    settings.high = { env = { target_db = -60.0 }, agent = { gamma = 0.5 }, algorithms = ["dqn"] }
    """
    configs = load(tmp_path, text).configs()
    assert [str(config.out) for config in configs] == [
        "runs/low/ppo/seed0", "runs/low/dqn/seed0", "runs/high/dqn/seed0",
        "runs/low/ppo/seed1", "runs/low/dqn/seed1", "runs/high/dqn/seed1",
    ]  # fmt: skip
    default = defaults_of("dqn")
    assert configs[-1] == replace(
        default,
        agent=replace(default.agent, gamma=0.5),
        env=replace(default.env, target_db=-60.0),
        out=Path("runs/high/dqn/seed1"),
        seed=1,
        progress=False,
    )


def test_run_of_a_sweep_is_that_of_the_command_line(tmp_path):
    (config,) = Plan.load(write(tmp_path, seeds=1)).configs()
    words = [*TINY["q_learning"], "--agent.total-timesteps", "320"]
    assert record_of(config) == record_of(parse("q_learning", words))


def test_scoreboard_holds_the_eight_problems_and_ten_seeds_of_every_algorithm():
    board = Plan.load(SWEEPS / "scoreboard.toml")
    board.check()
    configs = board.configs()
    assert len(configs) == 8 * 5 * 10
    assert {config.agent.algorithm for config in configs} == set(specialists()) - {
        "ppo_lagrangian"  # has a bound on the cost, and a board of its own
    }
    assert all(config.agent == defaults_of(config.agent.algorithm).agent for config in configs)
    hardware = {
        (config.env.irs_elements is None, config.env.phase_bits, config.env.target_db): build_world(
            config.env
        ).scene
        for config in configs
    }
    assert sorted(hardware, key=str) == sorted(
        [(False, None, -62.5), (True, 1, -61.8), (True, 1, -62.5), (True, 2, -61.8)]
        + [(True, None, target_db) for target_db in (-62.5, -61.8, -61.2, -60.0)],
        key=str,
    )
    assert {sum(panel.elements for panel in scene.irs_panels) for scene in hardware.values()} == {
        0,
        1200,
    }


def test_each_ablation_changes_one_thing():
    configs = Plan.load(SWEEPS / "ablations.toml").configs()
    assert len(configs) == 9 * 5
    default = record_of(configs[0]).model_dump()
    assert default == record_of(defaults_of("ppo")).model_dump()
    changes = {}
    for config in configs[:9]:
        record = record_of(config).model_dump()
        changed = {
            name: value
            for part in ("env", "agent", "training")
            for name, value in record[part].items()
            if value != default[part][name]
        }
        changed |= {"algorithm": record["algorithm"]} if record["algorithm"] != "ppo" else {}
        changes[config.out.parents[1].name] = changed
    assert changes == {
        "default": {},
        "no-shaping": {"shaping": False},
        "fixed-start": {"random_start": False},
        "no-gain-patch": {"patch_radius": 0},
        "no-irs-settings": {"irs_phases": False},
        "mask": {"algorithm": "maskable_ppo"},
        "discount-0.99": {"gamma": 0.99},
        "discount-0.995": {"gamma": 0.995},
        "discount-1": {"gamma": 1.0},
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("seeds = 2", "seeds = 0"), "seeds: Input should be greater than or equal to 1"),
        (('["q_learning"]', '["sarsa"]'), r"algorithms\.0.*Input should be 'ppo'"),
        (("seeds = 2", "seeds = 2\nworkers = 3"), "workers: Extra inputs are not permitted"),
        (
            ("settings.short", 'settings."../elsewhere"'),
            r"settings.../elsewhere.\[key\]: String should match",
        ),
        (
            ("patch_radius = 1", "patch = 1"),
            "settings.short.env: .* unexpected keyword argument .patch.:",
        ),
        (("patch_radius = 1", "target_db = -50"), "target_db=-50.0 is infeasible"),
        (("patch_radius = 1", 'scene = "nowhere.json"'), "nowhere.json"),
        (
            ("n_envs = 4", "n_envs = 0"),
            r"settings.short.agent \(q_learning\): n_envs=0 must be a positive integer",
        ),
        (
            ("n_envs = 4", "n_steps = 4"),
            r"settings.short.agent \(q_learning\): unknown name n_steps",
        ),
        (("eval_every = 64", "eval_every = 0"), "settings.short.training: eval_every=0"),
        (("seeds = 2", "seeds = "), "Invalid value"),
        (
            ("seeds = 2", "seeds = 1000000000"),
            "seeds=1000000000 make 1,000,000,000 runs, and a sweep has at most 100,000",
        ),
        (("seeds = 2", f"seeds = {'[' * 10_000}"), "sweep.toml: "),
        (("seeds = 2", "#" * 2**20), "sweep.toml' holds .* bytes, and at most 1,048,576 are read"),
    ],
)
def test_bad_sweep_is_refused_by_name_before_any_work(capsys, tmp_path, change, message):
    file = write(tmp_path)
    file.write_text(file.read_text().replace(*change))
    with pytest.raises((PlanError, OSError), match=message):
        Plan.load(file).check()
    assert call(["sweep", file]) == 2
    said = capsys.readouterr().err
    assert said.startswith("python -m train sweep: ")
    assert said.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_missing_file_and_impossible_options_are_refused(capsys, tmp_path):
    assert call(["sweep", tmp_path / "nowhere.toml"]) == 2
    assert call(["sweep", write(tmp_path), "--jobs", 0]) == 2
    assert "jobs=0 must be 1 or more" in capsys.readouterr().err


def test_runs_with_other_settings_are_not_taken_for_those_of_the_sweep(tmp_path):
    file = write(tmp_path)
    config = Plan.load(file).configs()[0]
    Run.create(config.out, record_of(config))
    Plan.load(file).check()
    write(tmp_path, steps=640)
    with pytest.raises(PlanError, match="seed0' holds a run with other settings"):
        Plan.load(file).check()


def test_folder_that_is_no_run_is_not_touched(tmp_path):
    file = write(tmp_path)
    (tmp_path / "runs/short/q_learning/seed1").mkdir(parents=True)
    with pytest.raises(ValueError, match="seed1' is not a run folder"):
        Plan.load(file).check()


def hashes(folder: Path) -> dict[str, str]:
    return {
        path.name: sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.is_file()
    }


def sweep(file: Path, *words: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "train", "sweep", str(file), "--jobs", "2", *words]
    return subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


EXPLODING = """
[settings.exploding]
algorithms = ["ppo"]
agent = { learning_rate = 1e30, final_learning_rate = 1e30, n_envs = 4, n_steps = 16, batch_size = 32 }
env = { patch_radius = 1 }
"""


def test_sweep_goes_on_with_what_was_cut_leaves_what_has_ended_and_keeps_what_fails(tmp_path):
    words = ["q_learning", *TINY["q_learning"], "--agent.total-timesteps", 320]
    runs = tmp_path / "runs/short/q_learning"
    assert call([*words, "--seed", 1, "--out", tmp_path / "alone"]) == 0
    assert call([*words, "--seed", 0, "--out", runs / "seed0"]) == 0
    ended = hashes(runs / "seed0")
    cut(words, runs / "seed1")

    process = sweep(write(tmp_path, more=EXPLODING), "--retries", "0")
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 1
    assert hashes(runs / "seed0") == ended
    run, alone = Run.open(runs / "seed1"), Run.open(tmp_path / "alone")
    assert curve(run.folder) == curve(alone.folder)
    assert (numbers(run)[0] == numbers(alone)[0]).all()
    assert "2 of 4 runs, 2 failed" in said
    for seed in range(2):
        run = Run.open(tmp_path / f"runs/exploding/ppo/seed{seed}")
        assert run.manifest.status == "failed"
        assert run.manifest.error.startswith("ValueError: ")
        told = (run.folder / "traceback.txt").read_text()
        assert "in _train\n" in told
        assert "\x1b" not in told


def test_failed_run_is_tried_again_then_kept_as_failed_then_tried_by_the_next_sweep(
    tmp_path, monkeypatch
):
    def fail(_):
        raise ray.exceptions.WorkerCrashedError

    monkeypatch.setattr(ray, "get", fail)
    runs = Sweep(Plan.load(write(tmp_path, seeds=1)), retries=1)
    for remaining in (1, 0):
        runs.running = {"task": runs.waiting.pop()}
        said = runs._end("task")
        assert len(runs.waiting) == remaining
        assert ("is tried again" in said) == bool(remaining)
    assert list(runs.states.values()) == ["failed"]
    (folder,) = runs.states
    assert Run.open(folder).manifest.error.startswith("WorkerCrashedError: The worker died")
    assert len(Sweep(Plan.load(write(tmp_path, seeds=1)), retries=1).waiting) == 1


@pytest.mark.parametrize("retries", [0, 1])
def test_run_of_another_process_is_left_to_it(tmp_path, monkeypatch, retries):
    runs = Sweep(Plan.load(write(tmp_path, seeds=1)), retries)
    (folder,) = runs.states
    config = runs.waiting.pop()
    Run.create(folder, record_of(config))

    def busy(_):
        raise ray.exceptions.RayTaskError(
            "_train", "", LockedError("it is being trained")
        ).as_instanceof_cause()

    monkeypatch.setattr(ray, "get", busy)
    runs.running = {"task": config}
    assert "another process is training it" in runs._end("task")
    assert list(runs.states.values()) == ["elsewhere"]
    assert (len(runs.waiting), Run.open(folder).manifest.status) == (0, "running")


def test_failure_is_not_written_into_a_run_that_another_process_has_taken_over(
    tmp_path, monkeypatch
):
    def fail(_):
        raise ray.exceptions.WorkerCrashedError

    monkeypatch.setattr(ray, "get", fail)
    runs = Sweep(Plan.load(write(tmp_path, seeds=1)), retries=0)
    (folder,) = runs.states
    config = runs.waiting.pop()
    run = Run.create(folder, record_of(config))
    for is_ended in (False, True):
        runs.running = {"task": config}
        if is_ended:
            run.update(status="finished")
            runs._end("task")
        else:
            with run.locked():
                runs._end("task")
        assert runs.states[folder] == ("ended" if is_ended else "elsewhere")
        assert run.manifest.status == ("finished" if is_ended else "running")


def test_sweep_leaves_a_run_to_who_trains_it_and_passes_a_signal_on_to_its_workers(tmp_path):
    file = write(tmp_path, steps=10**7)
    config, other = Plan.load(file).configs()
    run = Run.create(other.out, record_of(other))
    with run.locked():  # by another sweep, say
        process = sweep(file, "--retries", "0")
        wait_for_checkpoint(process, config.out)
        first = ""
        while "another process" not in first:
            line = process.stdout.readline()
            assert line, first
            first += line
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=300)
    assert process.returncode == 128 + signal.SIGTERM, said
    assert "interrupted; the same command goes on" in said
    assert "another process is training it" in " ".join((first + said).split())
    assert Run.open(config.out).manifest.status == "interrupted"
    assert run.manifest.status == "running"


def wait_for_checkpoint(process: subprocess.Popen, folder: Path) -> None:
    deadline = time.monotonic() + 120
    while not (folder.exists() and Run.open(folder).manifest.checkpoints):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)


def cut(words: list[object], folder: Path) -> None:
    """Train with seed 1 until the second checkpoint is written."""
    save = Run.save_checkpoint

    def save_and_stop(run: Run, content: bytes, steps: int) -> None:
        save(run, content, steps)
        if steps >= 192:
            raise RuntimeError("cut")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Run, "save_checkpoint", save_and_stop)
        with pytest.raises(RuntimeError, match="cut"):
            call([*words, "--seed", 1, "--out", folder])


def test_sweep_that_is_killed_goes_on(tmp_path):
    file = write(tmp_path, steps=6_400)
    process = sweep(file)
    folders = [tmp_path / f"runs/short/q_learning/seed{seed}" for seed in range(2)]
    wait_for_checkpoint(process, folders[0])
    process.kill()
    process.communicate(timeout=60)
    assert not all(
        folder.exists() and Run.open(folder).manifest.status in resume.ENDED for folder in folders
    )
    process = sweep(file)
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 0, said
    for seed, folder in enumerate(folders):
        run = Run.open(folder)
        assert run.manifest.status in resume.ENDED
        assert run.config.seed == seed
    assert "2 of 2 runs, 0 failed" in said


def test_sweeps_over_many_scenes_hold_every_generalist_and_the_curve():
    plans = [
        Plan.load(SWEEPS / f"{name}.toml")
        for name in (
            "generalisation",
            "generalisation-explorer",
            "generalisation-slow",
            "generalisation-sb3",
        )
    ]
    configs = [config for plan in plans for config in plan.configs()]
    after = Plan.load(SWEEPS / "generalisation-then-ppo.toml")
    trained = {config.agent.algorithm for config in [*configs, *after.configs()]}
    assert trained == set(generalists())
    planners = [
        config for config in configs if config.agent.algorithm == "planner" and config.seed == 0
    ]
    assert {config.env.num_scenes for config in planners} == {10, 100, 1000, 3000, 10000}
    folders = {config.out for config in configs}
    for config in after.configs():
        assert (
            config.agent.weights in folders
        )  # what they begin with is trained by the sweep before
        assert f"seed{config.seed}" in str(config.agent.weights)


@pytest.mark.parametrize("name", ["generalisation-families", "generalisation-families-then-ppo"])
def test_sweeps_over_families_leave_each_out_of_what_its_agents_learn_on(name):
    plan = Plan.load(SWEEPS / f"{name}.toml")
    assert set(plan.settings) == {f"all-but-{name}" for name in FAMILIES}
    for config in plan.configs():
        family = config.out.parts[-3].removeprefix("all-but-")
        assert config.env.split == all_but(family)
        assert f"train-{family}" not in members_of(config.env.split)
        assert config.env.test_split == "val"


def test_curriculum_goes_from_usual_factories_to_those_where_walls_decide():
    usual = Plan.load(SWEEPS / "generalisation-explorer.toml")
    first = {config.out: config for config in usual.configs()}
    walls = [f"train-{name}" for name, each in FAMILIES.items() if each.family]
    imitation = list(Plan.load(SWEEPS / "generalisation-curriculum.toml").configs())

    for config in imitation:
        before = first[config.agent.weights]
        assert (before.seed, before.env.split) == (config.seed, "train")
        assert members_of(config.env.split) == (*["train"] * len(walls), *walls)  # half and half

    second = {config.out: config for config in imitation}
    for config in Plan.load(SWEEPS / "generalisation-curriculum-then-ppo.toml").configs():
        before = second[config.agent.weights]
        assert (before.seed, before.env) == (config.seed, config.env)


def test_ppo_with_a_family_left_out_begins_with_what_imitation_has_found_without_it():
    before = Plan.load(SWEEPS / "generalisation-families.toml")
    after = Plan.load(SWEEPS / "generalisation-families-then-ppo.toml")
    usual = Plan.load(SWEEPS / "generalisation-then-ppo.toml")
    like = next(each for each in usual.configs() if each.agent.algorithm == "explorer_ppo").agent
    found = {each.out: each for each in before.configs()}

    for config in after.configs():
        first = found[config.agent.weights]
        assert (first.seed, first.env) == (config.seed, config.env)
        steps = like.total_timesteps // 3  # as the page says
        assert config.agent == replace(like, weights=config.agent.weights, total_timesteps=steps)
        assert first.agent == ExplorerConfig(total_timesteps=ExplorerConfig().total_timesteps // 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"env": {"num_scene": 3}},
            r"settings.default.env: .* unexpected keyword argument .num_scene.",
        ),
        (
            {"env": {"num_scenes": 0}},
            r"settings.default.env: num_scenes=0 must be a positive integer",
        ),
        (
            {"agent": {"width": 0}},
            r"settings.default.agent \(planner\): width=0 must be a positive integer",
        ),
    ],
)
def test_bad_sweep_over_many_scenes_is_refused_by_name(change, message):
    plan = Plan(
        out=Path("runs/none"), seeds=1, algorithms=("planner",), settings={"default": change}
    )
    with pytest.raises(PlanError, match=message):
        plan.check()
