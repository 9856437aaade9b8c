"""Facts of pools: each scene as it is alone, a smaller pool the head of a larger, and a cache that
cannot do harm.
"""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from irs_gym.datasets import build_shards, scene_set, shard, splits
from irs_gym.datasets.cache import cache_folder, read_cached, write_cached
from irs_gym.datasets.scene_set import build_scene_set, scene_set_of
from irs_gym.datasets.shard import Shard, build_shard, definition_of
from irs_gym.datasets.solved_scene import solve
from irs_gym.datasets.splits import scene_of
from irs_gym.mdp.task import Task, build_world
from irs_gym.radio.scene import load_scene

ARRAYS = ("target_db", "gain_db", "distance_to_go", "irs", "start", "goal")
SCENES = [scene_of("train", index) for index in range(3)]
PAPER, WORKSHOP = (
    load_scene("paper"),
    load_scene("workshop").model_copy(update={"target_db": -64.0, "phase_bits": 1}),
)


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    """A cache of the test's own, and blocks small enough to have several."""
    monkeypatch.setenv("IRS_GYM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(build_shards, "SHARD_SCENES", 2)
    return tmp_path / "cache"


def same(one, other):
    return one.names == other.names and all(
        np.array_equal(getattr(one, n), getattr(other, n)) for n in ARRAYS
    )


# --- pools of given scenes ------------------------------------------------------------------------


def test_each_scene_of_a_pool_is_as_it_is_alone():
    scenes = [PAPER, WORKSHOP, *SCENES]
    found = scene_set_of(scenes)
    assert found.shape == (64, 40)
    for n, scene in enumerate(scenes):
        world, alone = build_world(Task(scene=scene)), solve(scene)
        x, y = alone.radio_map.grid.shape
        assert np.array_equal(found.gain_db[n, :x, :y], world.radio_map.gain_db)
        assert np.array_equal(found.feasible[n, :x, :y], world.feasible)
        assert np.array_equal(found.free[n, :x, :y], world.radio_map.free)
        assert np.array_equal(found.distance_to_go[n, :x, :y], alone.distance_to_go)
        assert (tuple(found.start[n]), tuple(found.goal[n])) == (world.start, world.goal)
        assert np.array_equal(found.irs[n], world.irs[0, 0, :3])
        assert found.oracle_distance[n] == alone.oracle_distance
        assert found.target_db[n] == world.target_db
        outside = np.ones(found.shape, dtype=bool)
        outside[:x, :y] = False
        assert not found.free[n][outside].any()
        assert np.isposinf(found.distance_to_go[n][outside]).all()
        assert np.isneginf(found.gain_db[n][outside]).all()


def test_the_paper_and_its_optimum_are_in_a_pool():
    found = scene_set_of([PAPER], ["mine"], frame=(50, 60))
    assert (found.names, found.shape, len(found)) == (("mine",), (50, 60), 1)
    assert found.oracle_distance[0] == pytest.approx(23.228, abs=5e-4)
    assert found.scenes[0] is PAPER


def test_the_arrays_of_a_pool_cannot_be_changed():
    found = scene_set_of(SCENES[:1])
    for name in (*ARRAYS, "free", "feasible", "oracle_distance"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(found, name)[0] = 0


@pytest.mark.parametrize(
    ("scenes", "arguments", "message"),
    [
        ([], {}, "scenes is empty"),
        (
            [PAPER, PAPER.model_copy(update={"target_db": -50.0})],
            {"names": ["a", "b"]},
            r"scene 'b': target_db=-50.0 is infeasible .* the highest feasible target is -59\.51",
        ),
        ([PAPER, WORKSHOP], {"names": ["a"]}, "names has 1 entries for 2 scenes"),
        (
            [PAPER, WORKSHOP],
            {"frame": (40, 40)},
            r"scene 'workshop' has \(64, 40\) cells: frame=\(40, 40\) is too small",
        ),
        ([WORKSHOP, PAPER], {"cell_size": 0.3}, "scene 'workshop': cell_size=0.3 does not divide"),
        (
            [PAPER.model_copy(update={"goal": (-9.9, 0.1)})],
            {},
            "scene 'paper': start=.* lies in the same cell",
        ),
    ],
)
def test_scenes_that_make_no_pool_are_refused_by_name(scenes, arguments, message):
    with pytest.raises(ValueError, match=message):
        scene_set_of(scenes, **arguments)


# --- pools of a split -----------------------------------------------------------------------------


def test_a_pool_of_a_split_holds_its_scenes():
    found = build_scene_set("train", 3, jobs=1)
    assert same(found, scene_set_of(SCENES, frame=(40, 40)))
    assert list(found.scenes) == SCENES
    assert list(found.scenes[1:]) == SCENES[1:]
    assert found.names == ("train-0", "train-1", "train-2")


def test_a_smaller_pool_is_the_head_of_a_larger_whichever_is_built_first():
    small, large = build_scene_set("train", 1, jobs=1), build_scene_set("train", 3, jobs=1)
    again = build_scene_set("train", 1, jobs=1)
    assert same(small, again)
    assert all(np.array_equal(getattr(small, name), getattr(large, name)[:1]) for name in ARRAYS)


def test_a_pool_is_built_once(monkeypatch):
    first = build_scene_set("train", 3, jobs=1)
    monkeypatch.setattr(build_shards, "build_shard", None)
    assert same(build_scene_set("train", 3, jobs=1), first)
    assert same(build_scene_set("train", 2, jobs=1), scene_set_of(SCENES[:2], frame=(40, 40)))


def test_several_processes_build_what_one_does(monkeypatch, tmp_path):
    alone = build_scene_set("train", 3, jobs=1)
    monkeypatch.setattr(build_shards, "build_shard", None)  # so that this process cannot help
    assert same(build_scene_set("train", 3, jobs=2, cache=tmp_path / "empty"), alone)


def test_a_script_without_a_main_guard_builds_a_pool_in_several_processes(tmp_path):
    text = "from irs_gym.datasets import build_shards, scene_set\n"
    text += "build_shards.SHARD_SCENES = 1\nbuild_shards.build_shard = None\n"
    (tmp_path / "script.py").write_text(
        text + "print(scene_set.build_scene_set('train', 2, jobs=2).names)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(build_shards.__file__).parents[2])}
    command = [sys.executable, "script.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("('train-0', 'train-1')\n", "")


def test_where_no_process_can_be_started_this_one_builds(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    assert same(build_scene_set("train", 3, jobs=2), scene_set_of(SCENES, frame=(40, 40)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nowhere",), "split='nowhere' must be one of"),
        (("test", 1001), "num_scenes=1001 must be a number from 1 to 1000, the scenes of 'test'"),
        (("test", 0), "num_scenes=0 must be"),
        (("test", True), "num_scenes=True must be"),
    ],
)
def test_pools_that_no_split_has_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        build_scene_set(*arguments)
    with pytest.raises(ValueError, match="jobs=0 must be 1 or more"):
        build_scene_set("train", 1, jobs=0)


def test_a_frozen_scene_that_comes_out_as_another_is_refused(monkeypatch):
    assert build_scene_set("val", 1, jobs=1).names == ("val-0",)
    monkeypatch.setattr(splits, "VERSION", 99)
    monkeypatch.setattr(shard, "VERSION", 99)
    with pytest.raises(RuntimeError, match="scene val-0 is not the one that was frozen"):
        build_scene_set("val", 1, jobs=1)


# --- the cache ------------------------------------------------------------------------------------


def _cut(path, other):
    path.write_bytes(path.read_bytes()[:-500])


def _flip(path, other):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def _swap(path, other):
    path.write_bytes(other.read_bytes())


def _empty(path, other):
    path.write_bytes(b"")


def _folder(path, other):
    path.unlink()
    path.mkdir()


def _text(path, other):
    path.write_text("nothing of the kind")


def _alter(path, other):
    """A whole archive that says the right thing and holds another map."""
    with np.load(path) as file:
        arrays = dict(file)
    arrays["gain_db"] = arrays["gain_db"] + 1.0
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


@pytest.mark.parametrize(
    "damage", [_cut, _flip, _swap, _empty, _folder, _text, _alter], ids=lambda each: each.__name__
)
def test_a_damaged_file_in_the_cache_is_built_anew(own_cache, damage):
    whole = build_scene_set("train", 4, jobs=1)
    first, second = sorted(own_cache.iterdir())
    damage(first, second)
    assert same(build_scene_set("train", 4, jobs=1), whole)


def test_a_damaged_file_is_replaced(own_cache, monkeypatch):
    whole = build_scene_set("train", 2, jobs=1)
    (file,) = own_cache.iterdir()
    _flip(file, None)
    build_scene_set("train", 2, jobs=1)
    monkeypatch.setattr(build_shards, "build_shard", None)
    assert same(build_scene_set("train", 2, jobs=1), whole)


def test_nothing_in_the_cache_is_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (tmp_path / "sprung").touch, ()

    definition = definition_of("train", 0, 1)
    whole = build_shard("train", 0, 1)
    with (tmp_path / "trap.npz").open("wb") as file:
        arrays = {
            **vars(whole),
            "texts": np.array([Trap()], dtype=object),
            "said": np.array([definition.encode()]),
        }
        np.savez(file, **arrays)
    with pytest.raises(ValueError, match="not the shard"):
        Shard.from_bytes((tmp_path / "trap.npz").read_bytes(), definition)
    assert not (tmp_path / "sprung").exists()


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path):
    (tmp_path / "file").touch()
    assert len(build_scene_set("train", 1, jobs=1, cache=tmp_path / "file" / "cache")) == 1


def test_the_name_of_a_file_tells_of_all_that_its_content_depends_on(monkeypatch):
    def name():
        return build_shards.file_of(definition_of("train", 0, 2), "train", 0)

    first = name()
    for version in ("VERSION", "PHYSICS_VERSION"):  # of the generator, and of the formulas
        with monkeypatch.context() as patch:
            patch.setattr(shard, version, 99)
            assert name() != first
    assert name() == first
    assert {"difficulty", "frame", "cell_size", "first", "count"} <= set(
        json.loads(definition_of("train", 0, 2))
    )


def test_files_written_at_once_are_whole(tmp_path):
    contents = [bytes([n]) * 200_000 for n in range(8)]
    threads = [
        threading.Thread(target=write_cached, args=(tmp_path, "file", each)) for each in contents
    ]
    for thread in threads:
        thread.start()
    for _ in range(50):
        assert read_cached(tmp_path, "file") in (None, *contents)
    for thread in threads:
        thread.join()
    assert read_cached(tmp_path, "file") in contents
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_the_cache_lies_where_the_user_says(monkeypatch, tmp_path):
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("IRS_GYM_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert cache_folder() == tmp_path / "irs_gym"
    build_scene_set("train", 1, jobs=1, cache=tmp_path / "given")
    assert len(list((tmp_path / "given").iterdir())) == 1
    assert scene_set.build_scene_set is build_scene_set
