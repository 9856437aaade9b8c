"""Facts of the run folder: what it keeps, what it refuses to load, and what a crash leaves behind."""

import errno
import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from agents.rollout.episode import arguments_of
from agents.runs import run_folder
from agents.runs.manifest import Config
from agents.runs.run_folder import LockedError, Run, RunError
from agents.single.model import build_model
from agents.single.ppo import PpoConfig
from agents.vec_env import IrsNavVecEnv
from irs_gym import RadioMap, load_scene
from irs_gym.files import write_file
from irs_gym.mdp.task import Task

ROOT = Path(__file__).resolve().parents[2]
TASK = Task(observation="flat", patch_radius=1, irs_phases=False)
TINY = PpoConfig(n_envs=2, n_steps=4, batch_size=8, net_arch=(4,))


def config(task: Task = TASK) -> Config:
    return Config(algorithm="ppo", seed=0, env=arguments_of(task), agent=asdict(TINY), training={})


@pytest.fixture(scope="module")
def models():
    env = IrsNavVecEnv(TINY.n_envs, **arguments_of(TASK))
    return [build_model(TINY, env, seed) for seed in range(2)]


@pytest.fixture
def run(tmp_path) -> Run:
    return Run.create(tmp_path / "run", config())


def save(run: Run, model, steps: int = 8, name: str = "best") -> None:
    run.save_model(name, model, steps, is_success=True, ratio=1.25)


def weights(model) -> np.ndarray:
    """Those that act, of a model or a policy."""
    policy = getattr(model, "policy", model)
    acting = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
    return np.concatenate([each.detach().numpy().ravel() for each in acting])


def model_file(run: Run) -> Path:
    return run.folder / run.manifest.models["best"].file


def test_model_comes_back_as_it_was_saved(run, models):
    save(run, models[0])
    loaded = Run.open(run.folder).load_model()
    assert np.array_equal(weights(loaded), weights(models[0]))
    assert not np.array_equal(weights(loaded), weights(models[1]))


def test_manifest_says_what_the_model_did_and_where_it_comes_from(run, models):
    save(run, models[0])
    manifest = Run.open(run.folder).manifest
    assert (manifest.models["best"].steps, manifest.models["best"].ratio) == (8, 1.25)
    assert {"python", "irs_gym", "torch", "stable_baselines3"} <= set(manifest.versions)


def test_task_comes_back_as_it_was_given(tmp_path):
    task = replace(TASK, target_db=-62.5, phase_bits=1, start=(0, 3), random_start=0.7)
    Run.create(tmp_path / "run", config(task))
    assert Run.open(tmp_path / "run").task == task


def test_model_with_one_changed_byte_is_not_loaded(run, models):
    save(run, models[0])
    content = bytearray(model_file(run).read_bytes())
    content[len(content) // 2] ^= 1
    model_file(run).write_bytes(content)
    with pytest.raises(
        RunError,
        match=r"best-8\.npz' is not loaded: its SHA-256 is [0-9a-f]{64}, and [0-9a-f]{64} in",
    ):
        run.load_model()


def test_model_that_was_exchanged_or_cut_is_not_loaded(run, models):
    save(run, models[1], name="last")
    save(run, models[0])
    whole = model_file(run).read_bytes()
    for content in ((run.folder / "last-8.npz").read_bytes(), whole[: len(whole) // 2], b""):
        model_file(run).write_bytes(content)
        with pytest.raises(RunError, match="is not loaded"):
            run.load_model()


def test_missing_model_is_named(run, models):
    with pytest.raises(RunError, match="lists no 'best' model"):
        run.load_model()
    save(run, models[0])
    model_file(run).unlink()
    with pytest.raises(RunError, match=r"best-8\.npz', which the manifest lists, cannot be read"):
        run.load_model()


def test_manifest_cannot_name_a_file_outside_its_folder(run, models):
    save(run, models[0])
    manifest = json.loads((run.folder / "manifest.json").read_text())
    manifest["models"]["best"]["file"] = "../best-8.npz"
    (run.folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(RunError, match=r"damaged: models\.best\.(\w+\.)?file"):
        run.load_model()


@pytest.mark.parametrize(
    ("name", "reason"), [("manifest.json", "is damaged"), ("config.json", "is not loaded")]
)
def test_damaged_records_are_refused_by_name(run, name, reason):
    path = run.folder / name
    path.write_text(path.read_text()[: path.stat().st_size // 2])
    with pytest.raises(RunError, match=f"{name}' {reason}"):
        Run.open(run.folder)


def change_file(run: Run, name: str, old: str, new: str, *, is_listed: bool) -> None:
    """Change a file, and its SHA-256 in the manifest where the change shall not be told by that."""
    path = run.folder / name
    path.write_text(path.read_text().replace(old, new))
    if is_listed:
        digest = sha256(path.read_bytes()).hexdigest()
        run.update(files={**run.manifest.files, name: digest})


def test_records_of_another_format_or_with_bad_settings_are_refused(run):
    change_file(run, "config.json", '"target_db": null', '"target_db": "low"', is_listed=True)
    with pytest.raises(RunError, match=r"config\.json'.*target_db"):
        Run.open(run.folder)
    change_file(run, "manifest.json", '"format_version": 1', '"format_version": 2', is_listed=False)
    with pytest.raises(RunError, match=r"manifest\.json'.*format_version"):
        Run.open(run.folder)


def test_edited_configuration_is_refused_by_name_with_both_hashes(run):
    listed = run.manifest.files["config.json"]
    change_file(run, "config.json", '"seed": 0', '"seed": 1', is_listed=False)
    found = sha256((run.folder / "config.json").read_bytes()).hexdigest()
    for read in (Run.open, lambda folder: Run(folder).config, lambda folder: Run(folder).task):
        with pytest.raises(
            RunError, match=rf"config\.json'.*SHA-256 is {found}, and {listed} in the manifest"
        ):
            read(run.folder)


@pytest.mark.parametrize(
    ("name", "argument"), [("scene.json", "scene"), ("radio_map.npz", "radio_map")]
)
def test_edited_copy_of_a_scene_or_map_is_refused_by_name(tmp_path, name, argument):
    given = {"scene": load_scene("paper").model_copy(update={"name": "mine"})}
    if argument == "radio_map":
        given = {
            "radio_map": RadioMap.from_array(np.zeros((2, 3)), 1.0),
            "start": (0, 0),
            "goal": (1, 1),
        }
    run = Run.create(tmp_path / "run", config(Task(**given)))
    path = run.folder / name
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(RunError, match=rf"{name}' is not loaded: its SHA-256 is"):
        Run.open(run.folder)


def test_run_names_no_scene_outside_its_folder(run, tmp_path):
    load_scene("paper").save(tmp_path / "elsewhere.json")
    elsewhere = json.dumps(str(tmp_path / "elsewhere.json"))
    change_file(run, "config.json", '"scene": "paper"', f'"scene": {elsewhere}', is_listed=True)
    with pytest.raises(
        RunError, match=r"config\.json': scene='.*elsewhere\.json' is not in the folder"
    ):
        Run.open(run.folder)


def test_model_of_an_older_version_is_refused_by_name(run, models):
    save(run, models[0])
    path = run.folder / "manifest.json"
    path.write_text(path.read_text().replace("best-8.npz", "best-8.zip"))
    with pytest.raises(RunError, match=r"best-8\.zip is a model of an older version.*: train anew"):
        Run.open(run.folder)
    run = Run.create(run.folder, config(), overwrite=True)
    run.update(files={})
    with pytest.raises(
        RunError,
        match=r"config\.json' is not read: the manifest holds no SHA-256 of it; train anew",
    ):
        Run.open(run.folder)


def test_folder_without_manifest_is_no_run(tmp_path):
    with pytest.raises(RunError, match=r"not a run folder: it has no manifest\.json"):
        Run.open(tmp_path)


def test_run_is_replaced_only_when_asked(run):
    (run.folder / "scores.json").write_text("old")
    with pytest.raises(RunError, match="holds a run"):
        Run.create(run.folder, config())
    assert (run.folder / "scores.json").exists()
    Run.create(run.folder, config(), overwrite=True)
    assert not (run.folder / "scores.json").exists()


@pytest.mark.parametrize("name", ["thesis", "thesis/chapter.txt"])
def test_what_is_not_a_run_is_never_replaced(tmp_path, name):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/chapter.txt").write_text("years of work")
    with pytest.raises(RunError, match="is not a run folder: it is never replaced"):
        Run.create(tmp_path / name, config(), overwrite=True)
    assert (tmp_path / "thesis/chapter.txt").read_text() == "years of work"


def test_newer_model_takes_the_place_of_the_older(run, models):
    save(run, models[0], steps=8)
    save(run, models[1], steps=16)
    assert [path.name for path in run.folder.glob("*.npz")] == ["best-16.npz"]
    assert np.array_equal(weights(run.load_model()), weights(models[1]))


@pytest.mark.parametrize("written", [0, 1])
def test_crash_while_a_model_is_saved_leaves_the_one_before(run, models, monkeypatch, written):
    save(run, models[0], steps=8)
    calls = []

    def crash(path: Path, content: bytes) -> None:
        if len(calls) == written:
            raise KeyboardInterrupt
        calls.append(path)
        write_file(path, content)

    monkeypatch.setattr(run_folder, "write_file", crash)
    with pytest.raises(KeyboardInterrupt):
        save(run, models[1], steps=16)
    assert len(calls) == written
    assert np.array_equal(weights(Run.open(run.folder).load_model()), weights(models[0]))


def test_file_that_cannot_be_replaced_stays_whole(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_file(path, b"old")

    def crash(*_):
        raise OSError("disk full")

    monkeypatch.setattr(run_folder.os, "replace", crash)
    with pytest.raises(OSError, match="disk full"):
        write_file(path, b"new")
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
    assert path.read_bytes() == b"old"


def test_own_scene_and_map_are_kept_with_the_run(tmp_path):
    scene = load_scene("paper").model_copy(update={"name": "mine", "start": (-10.0, 5.0)})
    scene.save(tmp_path / "mine.json")
    RadioMap.from_array(np.arange(6.0).reshape(2, 3), 1.0).save(tmp_path / "mine.npz")
    own_map = Task(radio_map=tmp_path / "mine.npz", start=(0, 0), goal=(1, 1))
    runs = [
        Run.create(tmp_path / f"run{n}", config(task))
        for n, task in enumerate([Task(scene=tmp_path / "mine.json"), own_map])
    ]
    (tmp_path / "mine.json").unlink()
    (tmp_path / "mine.npz").unlink()
    assert load_scene(runs[0].task.scene) == scene
    assert RadioMap.load(runs[1].task.radio_map).gain_db.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert runs[1].task.start == (0, 0)


def test_learning_curve_leaves_out_what_is_not_known(run):
    run.write_curve([{"steps": 8, "ratio": None}, {"steps": 16, "ratio": 1.0}])
    assert (run.folder / "learning_curve.csv").read_text() == "steps,ratio\n8,\n16,1.0\n"


def test_live_run_is_not_replaced_by_whatever_name(run, tmp_path):
    (tmp_path / "link").symlink_to(run.folder)
    with run.locked():
        assert (tmp_path / ".run.lock").is_file()
        with pytest.raises(LockedError, match="run' is being trained by another process"):
            Run.create(run.folder, config(), overwrite=True)
        with (
            pytest.raises(LockedError, match="link' is being trained"),
            Run(tmp_path / "link").locked(),
        ):
            pass
    Run.create(run.folder, config(), overwrite=True)
    assert not (tmp_path / ".run.lock").exists()


def test_folder_beside_a_locked_one_is_not_looked_at_before_it_is_free(tmp_path):
    with Run(tmp_path / "new").locked(), pytest.raises(LockedError):
        Run.create(tmp_path / "new", config())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["link", "current", "above", "below a file", "lock"])
def test_folder_that_cannot_hold_a_run_is_refused_by_name(tmp_path, monkeypatch, kind):
    (tmp_path / "here").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".locked.lock").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    folder, message = {
        "link": (tmp_path / "link", "link' is a symbolic link: name the folder that it leads to"),
        "current": (Path(), r"'\.' holds the folder that this program runs in"),
        "above": (Path(".."), r"'\.\.' holds the folder that this program runs in"),
        "below a file": (tmp_path / "file/run", "run' cannot be locked: .*file'"),
        "lock": (tmp_path / "locked", r"locked' cannot be locked: .*\.locked\.lock'"),
    }[kind]
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(RunError, match=message) as raised:
        Run.create(folder, config(), overwrite=True)
    assert "\n" not in str(raised.value)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("number", [errno.EBUSY, errno.EROFS])
def test_folder_that_cannot_be_moved_stays_as_it_is(run, monkeypatch, number):
    """A mount point, say."""
    rename, before = Path.rename, (run.folder / "manifest.json").read_bytes()

    def refuse(path, target):
        if run.folder in (path, Path(target)):
            raise OSError(number, os.strerror(number), str(run.folder))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(RunError, match=f"run' cannot be made: .*{os.strerror(number)}: '.*run'"):
        Run.create(run.folder, config(), overwrite=True)
    assert (run.folder / "manifest.json").read_bytes() == before
    assert [each.name for each in run.folder.parent.iterdir()] == ["run"]


def test_old_run_comes_back_where_the_new_one_cannot_take_its_place(run, monkeypatch):
    rename = Path.rename

    def refuse(path, target):
        if "manifest.json" in os.listdir(path) and path.name == f".run.{os.getpid()}":
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refuse)
    (run.folder / "scores.json").write_text("old")
    with pytest.raises(RunError, match="cannot be made"):
        Run.create(run.folder, config(), overwrite=True)
    assert (run.folder / "scores.json").read_text() == "old"


def test_only_what_dead_processes_left_is_removed(tmp_path):
    for name in (".run.123", ".run.123.old", ".run.12x", ".other.123", "run.123"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_text("{}")
    Run.create(tmp_path / "run", config())
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        ".other.123",
        ".run.12x",
        "run",
        "run.123",
    ]


# Each time in a child of its own, which dies before its first, second ... change to a file, as by
# SIGKILL.
REPLACE = """
import os, sys
from pathlib import Path
from agents.runs import provenance
from agents.runs.run_folder import Run
from agents.runs.manifest import Config

provenance.commit = lambda: None
os.fsync = lambda _: None
folder, changes = Path(sys.argv[1]), ("os.mkdir", "os.remove", "os.rename", "os.rmdir")

def create(seed, last=None):
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if last is not None:
        left = [last]
        def count(event, arguments):
            if event in changes or (event == "open" and arguments[1] in ("wb", "xb")):
                left[0] -= 1
                if left[0] < 0:
                    os._exit(9)
        sys.addaudithook(count)
    Run.create(folder, Config(algorithm="ppo", seed=seed, env={}, agent={}, training={}), overwrite=True)
    os._exit(0)

kills, status = 0, 9
assert create(0) == 0
while status == 9:
    status = create(1, kills)
    kills += 1
    if folder.exists():
        assert Run.open(folder).config.seed in (0, 1)
    assert create(0) == 0, kills
    assert Run.open(folder).config.seed == 0
    assert os.listdir(folder.parent) == [folder.name]
assert (status, kills > 8) == (0, True), kills
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork there")
def test_replacing_a_run_works_again_after_a_kill_at_any_change_of_a_file(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", REPLACE, tmp_path / "run"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
