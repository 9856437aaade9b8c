"""Facts of what others hand on: nothing in a run folder is run, but the checkpoint of one that the
user trusts.
"""

import json
import os
import pickle
import subprocess
import sys
import zipfile
from base64 import b64encode
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from evaluating import call as evaluate
from stable_baselines3 import PPO
from tiny import TINY, call, open_floor

from agents.policies.model_file import read_network
from agents.runs import signature
from agents.runs.pretrained import load_pretrained
from agents.runs.run_folder import Run, RunError
from agents.runs.weights import pack
from train.resume import ENDED

ROOT = Path(__file__).resolve().parents[2]


class Malice:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def as_pickle(harm: Path) -> bytes:
    return pickle.dumps(Malice(harm))


def as_array_of_objects(harm: Path) -> bytes:
    content = BytesIO()
    np.savez(content, table=np.array([Malice(harm)], dtype=object))
    return content.getvalue()


def as_model_of_stable_baselines(harm: Path) -> bytes:
    content = BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        serialized = {
            ":type:": "Malice",
            ":serialized:": b64encode(pickle.dumps(Malice(harm))).decode(),
        }
        archive.writestr("data", json.dumps({"policy_class": serialized}))
    return content.getvalue()


KINDS = [as_pickle, as_array_of_objects, as_model_of_stable_baselines]


def elsewhere(monkeypatch, tmp_path: Path) -> None:
    """From here on, another user works on another machine."""
    monkeypatch.setenv("IRS_GYM_KEY", str(tmp_path / "elsewhere" / "key"))


def here(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IRS_GYM_KEY", str(tmp_path / "here" / "key"))


def replace_file(run: Run, name: str, content: bytes) -> None:
    """Put another content in place of a file, with its SHA-256 in the manifest, as whoever made the
    run could.
    """
    (run.folder / name).write_bytes(content)
    digest = sha256(content).hexdigest()
    manifest = run.manifest
    models = {
        key: each.model_copy(update={"sha256": digest}) if each.file == name else each
        for key, each in manifest.models.items()
    }
    checkpoints = tuple(
        each.model_copy(update={"sha256": digest}) if each.file == name else each
        for each in manifest.checkpoints
    )
    files = {key: digest if key == name else each for key, each in manifest.files.items()}
    run.update(models=models, checkpoints=checkpoints, files=files)


def train(folder: Path, tmp_path: Path, *words: object, algorithm: str = "ppo") -> Run:
    floor = open_floor(tmp_path)
    assert (
        call(
            [
                algorithm,
                "--out",
                folder,
                *TINY[algorithm],
                "--agent.total-timesteps",
                256,
                *floor,
                *words,
            ]
        )
        == 0
    )
    return Run.open(folder)


def interrupted(folder: Path, tmp_path: Path, monkeypatch) -> Run:
    """A run with a checkpoint to go on from."""
    from train.evaluation import Evaluation

    test = Evaluation._test

    def interrupt(evaluation):
        test(evaluation)
        evaluation.is_interrupted |= evaluation.num_timesteps >= 128

    with monkeypatch.context() as patch:
        patch.setattr(Evaluation, "_test", interrupt)
        words = [*TINY["q_learning"], "--agent.total-timesteps", 256, *open_floor(tmp_path)]
        assert call(["q_learning", "--out", folder, *words]) == 130
    run = Run.open(folder)
    assert run.manifest.checkpoints
    return run


def resume(folder: Path, *words: str) -> int:
    return call(["q_learning", "--resume", folder, "--no-progress", *words])


def test_the_malice_of_these_tests_is_real(tmp_path):
    pickle.loads(as_pickle(tmp_path / "pickle"))
    with np.load(BytesIO(as_array_of_objects(tmp_path / "array")), allow_pickle=True) as arrays:
        _ = arrays["table"]
    with pytest.raises(Exception):  # noqa: B017, PT011  # it fails, but too late
        PPO.load(BytesIO(as_model_of_stable_baselines(tmp_path / "model")))
    assert {path.name for path in tmp_path.iterdir()} == {"pickle", "array", "model"}


@pytest.mark.parametrize("kind", KINDS)
def test_no_file_of_a_strangers_run_is_run_by_any_command(tmp_path, monkeypatch, kind, capsys):
    elsewhere(monkeypatch, tmp_path)
    runs, harm = tmp_path / "runs", tmp_path / "harm"
    for number, target in enumerate(("model", "map", "all")):
        run = train(runs / target / "ppo", tmp_path, "--seed", number)
        models = [each.file for each in run.manifest.models.values()]
        names = {"model": models, "map": ["radio_map.npz"], "all": [*models, "radio_map.npz"]}[
            target
        ]
        for name in names:
            replace_file(run, name, kind(harm))
        for name in ("unseen-test.npz", "best.zip", "checkpoint-1.pickle", "learning_curve.csv"):
            if target == "all":
                (run.folder / name).write_bytes(kind(harm))
    here(monkeypatch, tmp_path)

    for folder in runs.glob("*/*"):
        assert evaluate(monkeypatch, "score", folder) == 2
        assert evaluate(monkeypatch, "animate", folder) == 2
        assert evaluate(monkeypatch, "watch", folder) == 2
        assert call(["ppo", "--resume", folder]) == 2
    for file in runs.glob("*/*/best*.npz"):
        assert evaluate(monkeypatch, "score", file) == 2
        assert evaluate(monkeypatch, "animate", file) == 2
    for command in ("board", "pretrain", "ablations", "generalisation"):
        assert evaluate(monkeypatch, command, runs, "--out", tmp_path / command) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert not harm.exists()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "algorithm", ["planner", "map_ppo", "local_ppo", "recurrent_ppo", "explorer"]
)
def test_no_model_over_many_scenes_is_run(tmp_path, monkeypatch, kind, algorithm):
    from train.config import defaults_of, record_of

    run = Run.create(tmp_path / "runs" / algorithm, record_of(defaults_of(algorithm)))
    content = kind(tmp_path / "harm")
    (run.folder / "best-8.npz").write_bytes(content)
    entry = {
        "file": "best-8.npz",
        "sha256": sha256(content).hexdigest(),
        "steps": 8,
        "success": 1.0,
        "spl": 1.0,
    }
    manifest = json.loads((run.folder / "manifest.json").read_text())
    manifest |= {"models": {"best": entry}, "status": "finished"}
    (run.folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(
        RunError,
        match=r"best-8\.npz' is not loaded: .*(not a whole npz|holds objects|are no arrays|header is not)",
    ):
        Run.open(run.folder).load_model()
    words = ["--algorithms", algorithm, "--out", tmp_path / "models"]
    assert evaluate(monkeypatch, "pretrain", tmp_path / "runs", *words) == 2
    assert not list(tmp_path.glob("models/*.npz"))
    assert not (tmp_path / "harm").exists()


def test_strangers_checkpoint_is_run_only_where_the_user_trusts_it(tmp_path, monkeypatch, capsys):
    elsewhere(monkeypatch, tmp_path)
    run = interrupted(tmp_path / "run", tmp_path, monkeypatch)
    for entry in run.manifest.checkpoints:
        replace_file(run, entry.file, as_pickle(tmp_path / "harm"))
    run.own_manifest()  # to them it is their own
    here(monkeypatch, tmp_path)
    before = (run.folder / "manifest.json").read_bytes()
    assert resume(run.folder) == 2
    said = capsys.readouterr().err
    assert "is not known to be made by you on this machine" in said
    assert "runs code that is stored in its checkpoint" in said
    assert "--trust" in said
    assert (run.folder / "manifest.json").read_bytes() == before
    assert not (tmp_path / "harm").exists()
    with pytest.raises(TypeError):  # what the malice leaves behind is no checkpoint
        resume(run.folder, "--trust")
    assert (tmp_path / "harm").exists()


def test_run_made_elsewhere_goes_on_with_trust_and_is_ones_own_from_then_on(tmp_path, monkeypatch):
    elsewhere(monkeypatch, tmp_path)
    run = interrupted(tmp_path / "run", tmp_path, monkeypatch)
    here(monkeypatch, tmp_path)
    assert resume(run.folder) == 2
    assert resume(run.folder, "--trust") == 0
    assert run.manifest.status in ENDED
    run.own_manifest()


def test_manifest_that_was_changed_is_ones_own_no_more(tmp_path, monkeypatch, capsys):
    run = interrupted(tmp_path / "run", tmp_path, monkeypatch)
    (newest, *_) = run.manifest.checkpoints
    content = as_pickle(tmp_path / "harm")
    (run.folder / newest.file).write_bytes(content)
    path = run.folder / "manifest.json"
    path.write_text(path.read_text().replace(newest.sha256, sha256(content).hexdigest()))
    assert resume(run.folder) == 2
    assert "is not known to be made by you" in capsys.readouterr().err
    run.update(status="failed")  # whatever is noted down in it, it stays a stranger's
    assert resume(run.folder) == 2
    assert not (tmp_path / "harm").exists()


def test_sweep_asks_for_trust_in_runs_made_elsewhere(tmp_path, monkeypatch):
    from train.plan import Plan

    file = tmp_path / "sweep.toml"
    file.write_text(
        f'out = "{tmp_path / "runs"}"\nseeds = 1\nalgorithms = ["q_learning"]\n[settings.it]\n'
    )
    plan = Plan.load(file)
    (config,) = plan.configs()
    from train.config import record_of

    elsewhere(monkeypatch, tmp_path)
    Run.create(config.out, record_of(config))
    here(monkeypatch, tmp_path)
    with pytest.raises(RunError, match="--trust"):
        plan.check()
    plan.check(trust=True)


def test_key_is_made_once_whoever_asks_and_only_its_owner_reads_it(tmp_path, monkeypatch):
    code = "from agents.runs.signature import sign; print(sign(b'it'))"
    env = {**os.environ, "IRS_GYM_KEY": str(tmp_path / "settings" / "key")}
    started = [
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, env=env, stdout=subprocess.PIPE)
        for _ in range(6)
    ]
    assert len({each.communicate()[0] for each in started}) == 1
    assert [path.name for path in (tmp_path / "settings").iterdir()] == ["key"]
    assert (tmp_path / "settings" / "key").stat().st_mode & 0o777 == 0o600
    monkeypatch.setenv("IRS_GYM_KEY", env["IRS_GYM_KEY"])
    assert signature.verify(b"it", signature.sign(b"it"))
    assert not signature.verify(b"other", signature.sign(b"it"))
    assert not signature.verify(b"it", None)


@pytest.mark.parametrize("fault", ["folder", "readable", "short", "home"])
def test_without_a_key_runs_are_trained_and_resumed_with_trust(
    tmp_path, monkeypatch, capsys, fault
):
    key = tmp_path / "settings" / "key"
    monkeypatch.setenv("IRS_GYM_KEY", str(key))
    said = {
        "folder": "ettings",
        "readable": "chmod 600",
        "short": "not a file of 32 bytes",
        "home": "no home",
    }[fault]
    if fault == "folder":
        key.parent.write_text("a file where the folder should be")
    elif fault == "home":
        monkeypatch.delenv("IRS_GYM_KEY")
        monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
        monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    else:
        key.parent.mkdir()
        key.write_bytes(bytes(32 if fault == "readable" else 31))
        key.chmod(0o644 if fault == "readable" else 0o600)
    run = interrupted(tmp_path / "run", tmp_path, monkeypatch)
    assert "resuming it will ask for --trust" in capsys.readouterr().err
    assert resume(run.folder) == 2
    assert said in capsys.readouterr().err
    assert resume(run.folder, "--trust") == 0
    assert Run.open(run.folder).manifest.status in ENDED


def zeros(shape: tuple[int, ...], **more: np.ndarray) -> bytes:
    content = BytesIO()
    np.savez_compressed(content, table=np.zeros(shape, dtype=np.float32), **more)
    return content.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            zeros((2**26 + 1,)),
            "unpacks to holds 268,435,588 bytes, and at most 268,435,456 are read",
        ),
        (zeros((20, 8)), "does not fit its configuration"),
        (zeros((1,))[:-30], "not a whole npz archive"),
        (b"", "not a whole npz archive"),
    ],
    ids=["bomb", "other", "cut", "empty"],
)
@pytest.mark.parametrize("algorithm", ["ppo", "q_learning"])
def test_file_that_is_no_model_is_refused(tmp_path, algorithm, content, message):
    run = train(tmp_path / "run", tmp_path, algorithm=algorithm)
    replace_file(run, run.manifest.models["best"].file, content)
    with pytest.raises(
        RunError, match=rf"best-\d+\.npz' is not loaded: .*({message}|not one table)"
    ):
        run.load_model()


def test_header_that_lies_about_its_size_is_refused(tmp_path):
    run = train(tmp_path / "run", tmp_path)
    member = BytesIO()
    np.lib.format.write_array_header_1_0(
        member, {"descr": "<f4", "fortran_order": False, "shape": (10**12,)}
    )
    content = BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("action_net.bias.npy", member.getvalue())
    replace_file(run, run.manifest.models["best"].file, content.getvalue())
    with pytest.raises(RunError, match=r"but .* values of the type float32 are others"):
        run.load_model()


def test_configuration_of_huge_networks_is_refused_before_they_are_made(tmp_path):
    run = train(tmp_path / "run", tmp_path)
    path = run.folder / "config.json"
    record = json.loads(path.read_text())
    record["agent"]["net_arch"] = [10**6, 10**6]
    replace_file(run, "config.json", json.dumps(record).encode())
    with pytest.raises(RunError, match="does not fit its configuration, whose networks are larger"):
        run.load_model()


def test_file_of_a_huge_network_over_maps_is_refused_before_it_is_made():
    content, header = BytesIO(), {"network": "unet", "settings": {"width": 8_000, "passes": 1}}
    np.savez(content, header=np.array(json.dumps(header)))
    with pytest.raises(
        ValueError, match=r"does not hold a network over maps: settings.width=8000 must be"
    ):
        read_network(content.getvalue())


def test_pretrained_policies_of_sb3_over_many_scenes_are_arrays_too(tmp_path, monkeypatch):
    from agents.single.model import build_model
    from agents.vec_env import IrsNavVecEnv
    from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
    from train.config import defaults_of, record_of

    env = IrsNavVecEnv(
        64, vector_env=IrsNavRandomVectorEnv, split="val", num_scenes=2, observation="flat"
    )
    default = defaults_of("recurrent_ppo")
    model = build_model(default.agent, env, seed=0)
    run = Run.create(tmp_path / "runs" / "it", record_of(default))
    run.save_model("best", model, 8, success=0.5, spl=0.5)
    run.write_curve([{"steps": 8, "seconds": 1.0, "success": 0.5, "spl": 0.5}])
    run.update(status="finished")
    words = ["--algorithms", "recurrent_ppo", "--out", tmp_path / "models"]
    assert evaluate(monkeypatch, "pretrain", tmp_path / "runs", *words) == 0
    kept = load_pretrained("recurrent_ppo", folder=tmp_path / "models", split="val", num_scenes=2)
    observation = env.reset()
    ours, theirs = (each.predict(observation, deterministic=True) for each in (kept, model))
    np.testing.assert_array_equal(ours[0], theirs[0])
    assert (tmp_path / "models" / "recurrent_ppo.npz").read_bytes() == pack(run.config, model)
