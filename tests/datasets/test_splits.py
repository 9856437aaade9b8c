"""Facts of splits: frozen sets that stay what they were, no scene in two of them, and the unusual
ones unusual.
"""

import json

import numpy as np
import pytest

from irs_gym.datasets import splits, verify_splits
from irs_gym.datasets.generator import CELL_SIZE, DIFFICULTIES
from irs_gym.datasets.layouts.floor_plan import THICKNESS
from irs_gym.datasets.scene_hash import symmetries
from irs_gym.datasets.splits import FAMILIES, SPLITS, Split, digest, frozen, scene_of
from irs_gym.datasets.verify_splits import entry_of, shared
from irs_gym.radio.scene import load_scene, scene_names

FROZEN = [name for name, split in SPLITS.items() if split.is_frozen]
LEARNED = [f"train-{name}" for name in FAMILIES]
SAMPLE = {
    name: [scene_of(name, index) for index in (0, 1, 2, 500, 998, 999)]
    for name in SPLITS
    if name not in LEARNED
}
KEPT = json.loads(verify_splits.KEPT.read_bytes())


def test_the_splits_are_these():
    assert list(SPLITS) == [
        *("train", "val", "test", "ood-clutter", "ood-irs", "ood-size", "ood-rooms"),
        *("ood-maze", "ood-doors", "ood-spiral", "ood-zigzag", "ood-trap", "ood-racks"),
        *("ood-hall", "ood-aps"),
        *LEARNED,
    ]
    assert list(SPLITS)[1 : -len(LEARNED)] == FROZEN
    assert [SPLITS[name].size for name in FROZEN] == [1000] * 14
    assert len({split.number for split in SPLITS.values()}) == len(
        SPLITS
    )  # seeds of no two are the same


@pytest.mark.parametrize("name", FROZEN)
def test_frozen_scenes_are_what_they_were(name):
    kept = frozen()[name].scenes
    assert [digest(scene.model_dump_json().encode()) for scene in SAMPLE[name]] == [
        kept[index] for index in (0, 1, 2, 500, 998, 999)
    ]


def test_each_frozen_scene_has_a_checksum_of_its_own():
    for name in FROZEN:
        assert len(frozen()[name].scenes) == SPLITS[name].size
        assert len(frozen()[name].sha256) == 64
    every = [each for name in FROZEN for each in frozen()[name].scenes]
    assert all(len(each) == 8 for each in every)
    assert len(set(every)) > len(every) - 5  # eight digits of 14,000 checksums agree for few


def test_no_scene_was_in_two_places_when_they_were_frozen():
    scenes = KEPT["proof"]["scenes"]
    assert scenes["train"] >= 10_000
    assert scenes["package"] == len(scene_names())
    assert all(scenes[name] >= 200 for name in LEARNED)
    assert {name: scenes[name] for name in FROZEN} == {name: SPLITS[name].size for name in FROZEN}
    assert KEPT["proof"]["in_two_places"] == 0


def test_no_scene_of_a_sample_is_in_two_places():
    assert shared({"package": map(load_scene, scene_names()), **SAMPLE}) == []


def test_a_scene_in_two_places_is_found_turned_and_renamed():
    turned = symmetries(SAMPLE["test"][1])[6].model_copy(update={"name": "new"})
    assert shared({**SAMPLE, "mine": [turned]}) == [("test: test-1", "mine: new")]
    paper = symmetries(load_scene("paper"))[5].model_copy(update={"name": "new"})
    assert shared({"train": [*SAMPLE["train"], paper], "package": [load_scene("paper")]}) == [
        ("train: new", "package: paper")
    ]


def test_scenes_are_named_after_their_number_and_no_two_are_equal():
    assert [scene.name for scene in SAMPLE["ood-irs"]] == [
        f"ood-irs-{n}" for n in (0, 1, 2, 500, 998, 999)
    ]
    nameless = {
        each.model_copy(update={"name": ""}).model_dump_json()
        for some in SAMPLE.values()
        for each in some
    }
    assert len(nameless) == sum(map(len, SAMPLE.values()))


def test_every_scene_fits_the_frame_of_its_split():
    for name, scenes in SAMPLE.items():
        shapes = np.array([scene.grid(CELL_SIZE).shape for scene in scenes])
        assert (shapes <= SPLITS[name].frame).all()
        longest = max(SPLITS[name].difficulty.sides + (SPLITS[name].difficulty.other_sides or ()))
        assert longest / CELL_SIZE <= min(SPLITS[name].frame)


def test_the_unusual_splits_hold_what_no_training_scene_does():
    usual = DIFFICULTIES["default"]
    assert all(SPLITS[name].difficulty == usual for name in ("train", "val", "test"))
    assert min(len(scene.obstacles) for scene in SAMPLE["ood-clutter"]) > usual.boxes[1]
    for scene in SAMPLE["ood-irs"]:
        elements = [panel.elements for panel in scene.irs_panels]
        assert len(elements) != 1 or not 400 <= elements[0] <= 2400
    for scene in SAMPLE["ood-size"]:
        assert min(np.subtract(scene.room.upper, scene.room.lower)) > usual.sides[1]
    for scene in SAMPLE["ood-rooms"]:
        walls = [box for box in scene.obstacles if min(box.size[:2]) == THICKNESS]
        assert len(walls) >= 3
        assert {wall.size[2] for wall in walls} == {scene.room.height}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("tset", 0), r"split='tset' must be one of \('train', 'val', 'test'"),
        (("test", 1000), "index=1000 must be a number from 0 to 999: 'test' has no more scenes"),
        (("train", -1), "index=-1 must be a number from 0 to 999999"),
    ],
)
def test_what_no_split_has_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        scene_of(*arguments)


def test_the_proof_tells_of_a_scene_that_has_changed(monkeypatch, tmp_path, capsys):
    few = {"train": Split(number=0, size=10), "val": Split(number=1, size=2)}
    monkeypatch.setenv("IRS_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(verify_splits, "SPLITS", few)
    monkeypatch.setattr(verify_splits, "KEPT", tmp_path / "splits.json")
    command = ["proof", "--train", "3", "--jobs", "1"]
    monkeypatch.setattr("sys.argv", [*command, "--write"])
    assert verify_splits.main() == 0
    monkeypatch.setattr("sys.argv", command)
    assert verify_splits.main() == 0
    said = capsys.readouterr().out
    count = len(scene_names()) + 5
    assert f"{count} scenes, of which 3 for training: 0 are in two places" in said
    assert "changed since they were frozen: none" in said
    kept = json.loads(verify_splits.KEPT.read_bytes())
    assert kept["splits"]["val"] == entry_of(
        scene_of("val", n).model_dump_json().encode() for n in range(2)
    )
    assert "".join(kept["splits"]["val"]["scenes"]) == "".join(frozen()["val"].scenes[:2])
    monkeypatch.setattr(splits, "VERSION", 99)
    monkeypatch.setattr("irs_gym.datasets.shard.VERSION", 99)
    assert verify_splits.main() == 1
    assert "changed since they were frozen: val" in capsys.readouterr().out
