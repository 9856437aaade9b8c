"""Facts of the data sets: their labels are the oracle's, the same seed gives the same episodes, an
interruption loses nothing, and the metadata names every file by its hash.
"""

import json
from hashlib import sha256
from itertools import pairwise
from math import hypot

import networkx as nx
import numpy as np
import pytest
from tiny import call

from irs_gym.datasets.splits import SPLITS, frozen
from irs_gym.grid import MOVES
from irs_gym.mdp.dynamics import tabulate
from train.datasets import minari_dataset, scenes
from train.datasets.croissant import EPISODES, SCENES, dataset_metadata, scenes_metadata
from train.datasets.episodes import Source, collect
from train.datasets.labels import labels_of
from train.datasets.minari_dataset import Part, write_dataset
from train.datasets.scenes import DESCRIPTIONS, PUBLISHED, write_scenes

CELL_SIZE = 0.5


def distances(world) -> dict[tuple[int, int], float]:
    """Metres to the goal from each feasible cell, by networkx alone."""
    gain_db = world.radio_map.gain_db
    graph = nx.Graph()
    feasible = {tuple(cell) for cell in np.argwhere(gain_db >= world.target_db).tolist()}
    graph.add_nodes_from(feasible)
    for i, j in feasible:
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if (i + di, j + dj) in feasible:
                graph.add_edge((i, j), (i + di, j + dj), weight=CELL_SIZE * hypot(di, dj))
    return nx.single_source_dijkstra_path_length(graph, world.goal)


def check_steps(source: Source, episodes: int) -> int:
    """Hold each step's labels against networkx; returns the number of steps."""
    env = source.make_env()
    steps = 0
    for number in range(episodes):
        episode = collect(source, env, number)
        world = env.unwrapped.world
        to_go = distances(world)
        infos = {name: np.array(each) for name, each in episode.infos.items()}
        assert all(len(each) == len(episode.actions) + 1 for each in infos.values())
        assert infos["regret"][0] == 0.0

        cell = env.unwrapped._episode.start
        for t, action in enumerate(episode.actions):
            lengths = [
                CELL_SIZE * hypot(*move) + to_go.get(ahead, np.inf)
                for move, ahead in zip(MOVES.tolist(), ahead_of(cell), strict=True)
            ]
            assert infos["distance_to_go"][t] == pytest.approx(to_go[cell], abs=1e-9)
            best = np.array(lengths) <= to_go[cell] + 1e-9
            assert (infos["optimal_actions"][t] == best).all()

            is_refused = lengths[action] == np.inf
            lost = (
                CELL_SIZE * hypot(*MOVES[action]) if is_refused else lengths[action] - to_go[cell]
            )
            assert infos["regret"][t + 1] == pytest.approx(lost, abs=1e-9)
            assert infos["is_refused"][t + 1] == is_refused
            cell = cell if is_refused else ahead_of(cell)[action]
        steps += len(episode.actions)
    return steps


def ahead_of(cell):
    return [tuple(each) for each in (np.array(cell) + MOVES).tolist()]


def test_labels_are_the_oracles_at_ten_thousand_random_steps():
    assert check_steps(Source(policy="random", random_start=1.0, seed=3), 30) > 10_000


@pytest.mark.parametrize("policy", ["mixed", "oracle"])
def test_labels_are_the_oracles_on_many_scenes(policy):
    source = Source(policy=policy, env="IrsNavRandom-v0", split="val", num_scenes=3)
    assert check_steps(source, 6) > 100


def test_a_way_loses_in_return_what_its_regrets_add_up_to():
    source = Source(policy="mixed", seed=1)
    env = source.make_env()
    arrived = 0
    for number in range(10):
        episode = collect(source, env, number)
        best = -episode.infos["oracle_distance"][0]
        start = np.array(env.unwrapped._episode.start) - env.unwrapped.world.goal
        octile = CELL_SIZE * (np.abs(start).max() + (2**0.5 - 1) * np.abs(start).min())
        if episode.terminations[-1]:
            arrived += 1
            lost = best + octile + 10.0 - sum(episode.rewards)
            assert sum(episode.infos["regret"]) == pytest.approx(lost, abs=1e-9)
    assert arrived > 3


def test_the_oracle_draws_among_its_best_actions_and_loses_nothing():
    source = Source()
    env = source.make_env()
    episodes = [collect(source, env, number) for number in range(20)]
    assert all(sum(each.infos["regret"]) == 0 and each.infos["is_success"][-1] for each in episodes)
    from_start = {tuple(each.actions) for each in episodes if each.infos["distance_to_go"][0] > 23}
    assert len(from_start) > 1


def test_labels_are_of_refusing_rules_alone():
    world = Source().make_env(constraint="allow").unwrapped.world
    with pytest.raises(ValueError, match="constraint='allow'"):
        labels_of(world, world.goal)


def test_an_action_is_optimal_where_its_regret_is_none():
    world = Source().make_env().unwrapped.world
    labels = labels_of(world, world.goal)
    to_go = tabulate(world, world.goal).distance_to_go.ravel()
    can = np.isfinite(to_go) & (to_go > 0)
    assert (labels.is_optimal[can] == (labels.regret[can] == 0)).all()
    assert (labels.regret[can] >= 0).all()
    assert not labels.is_optimal[~can].any()


def test_an_episode_depends_on_its_seed_and_number_alone():
    def episode(seed, number, before=0):
        source = Source(policy="mixed", seed=seed)
        env = source.make_env()
        for each in range(before):
            collect(source, env, each)
        return {name: each.tolist() for name, each in collect(source, env, number).arrays().items()}

    assert episode(0, 4) == episode(0, 4, before=3)
    assert episode(0, 4) != episode(0, 5)
    assert episode(0, 4) != episode(1, 4)


@pytest.mark.parametrize("observation", ["flat", "dict", "masked", "map", "cell"])
def test_a_part_keeps_its_episodes(observation, monkeypatch):
    source = Source(policy="mixed", observation=observation, seed=2)
    env = source.make_env()

    class Bar:
        def update(self):
            pass

    part = Part.from_bytes(Part.collected(source, env, 0, 3, Bar()).to_bytes())
    for number, arrays in enumerate(part.episodes()):
        alone = collect(source, env, number).arrays()
        assert set(arrays) == set(alone)
        assert all(np.array_equal(arrays[name], alone[name]) for name in alone)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"episodes": 0}, "episodes=0"),
        ({"episodes": 10**9}, "episodes=1000000000"),
        ({"seed": -1}, "seed=-1"),
        ({"policy": "best"}, "policy='best'"),
        ({"split": "val"}, "split cannot be given"),
        ({"env": "IrsNavRandom-v0", "target_db": -60.0}, "target_db cannot be given"),
        ({"split": "moon"}, "split='moon'"),
    ],
)
def test_a_source_that_cannot_be_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Source(**settings)


def test_commands_refuse_before_they_begin(tmp_path, capsys, monkeypatch):
    def said(*words):
        assert call([*words, "--out", tmp_path]) == 2
        return capsys.readouterr().err

    assert "name='../x' must be" in said("dataset", "--name", "../x")
    assert "split='train' must be one of val" in said("scenes", "--split", "train")
    monkeypatch.setattr(minari_dataset, "find_spec", lambda name: None)
    assert 'pip install -e ".[datasets]"' in said("dataset")
    assert not list(tmp_path.iterdir())


def test_scenes_are_written_as_the_frozen_files(tmp_path, monkeypatch):
    few = scenes.build_scene_set("val", 2)
    texts = b"".join(each.model_dump_json().encode() + b"\n" for each in few.scenes)
    monkeypatch.setattr(scenes, "build_scene_set", lambda split, size: few)
    with pytest.raises(ValueError, match="not those that were frozen"):
        write_scenes(tmp_path, ["val"])

    kept = {"val": frozen()["val"].__class__(sha256(texts).hexdigest(), ())}
    monkeypatch.setattr(scenes, "frozen", lambda: kept)
    write_scenes(tmp_path, ["val"])
    assert (tmp_path / "val.jsonl").read_bytes() == texts
    metadata = json.loads((tmp_path / "croissant.json").read_text())
    assert metadata["distribution"][0]["sha256"] == kept["val"].sha256
    assert set(DESCRIPTIONS) == {name for name, split in SPLITS.items() if split.is_frozen}


def check_structure(metadata, folder):
    """What Croissant 1.0 asks of metadata."""
    assert metadata["conformsTo"] == "http://mlcommons.org/croissant/1.0"
    assert {"name", "description", "license", "creator", "datePublished", "version"} <= set(
        metadata
    )
    files = {each["@id"]: each for each in metadata["distribution"]}
    for name, each in files.items():
        content = (folder / name).read_bytes()
        assert each["@type"] == "cr:FileObject"
        assert each["sha256"] == sha256(content).hexdigest()
        assert each["contentSize"] == f"{len(content)} B"

    ids = list(files)
    for records in metadata["recordSet"]:
        ids.append(records["@id"])
        for field in records["field"]:
            ids.append(field["@id"])
            lines = (folder / field["source"]["fileObject"]["@id"]).read_text().splitlines()
            assert all(field["source"]["extract"]["column"] in json.loads(line) for line in lines)
        assert records["key"]["@id"] in ids
    assert len(ids) == len(set(ids))


def test_metadata_tells_every_file_and_column(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "main_data.hdf5").write_bytes(b"steps")
    (tmp_path / "data" / "metadata.json").write_text("{}")
    row = {name: 0 for name, _, _ in EPISODES}
    (tmp_path / "episodes.jsonl").write_text(json.dumps(row) + "\n")
    described = {"name": "a", "description": "b", "version": "0.1.0", "commit": None}
    check_structure(dataset_metadata(**described, folder=tmp_path), tmp_path)

    row = {name: 0 for name, _, _ in SCENES}
    (tmp_path / "val.jsonl").write_text(json.dumps(row) + "\n")
    about = {"version": "0.1.0", "published": PUBLISHED, "splits": {"val": "some"}}
    check_structure(scenes_metadata(**about, folder=tmp_path), tmp_path)


@pytest.mark.needs("minari")
def test_an_interrupted_data_set_goes_on_and_is_the_same_needs_minari(tmp_path, monkeypatch):
    import minari

    source = Source(policy="mixed", episodes=70, seed=5)
    whole = write_dataset(source, "whole-v0", tmp_path, progress=False)

    collected = []

    def counted(own, env, number):
        collected.append(number)
        if number == 60 and collected.count(60) == 1:
            raise KeyboardInterrupt
        return collect(own, env, number)

    monkeypatch.setattr(minari_dataset, "collect", counted)
    with pytest.raises(KeyboardInterrupt):
        write_dataset(source, "other-v0", tmp_path, progress=False)
    assert not (tmp_path / "irs-nav" / "other-v0").exists()

    other = write_dataset(source, "other-v0", tmp_path, progress=False)
    assert collected == [*range(61), *range(50, 70)]
    assert (whole / "episodes.jsonl").read_bytes() == (other / "episodes.jsonl").read_bytes()
    one, two = (minari.MinariDataset(each / "data") for each in (whole, other))
    for a, b in zip(one, two, strict=True):
        assert (a.observations == b.observations).all()
        assert all((a.infos[name] == b.infos[name]).all() for name in a.infos)

    with pytest.raises(ValueError, match="exists: name another"):
        write_dataset(source, "other-v0", tmp_path, progress=False)
    check_structure(json.loads((whole / "croissant.json").read_text()), whole)
    assert sorted(each.name for each in whole.parent.iterdir()) == [
        "namespace_metadata.json", "other-v0", "whole-v0",
    ]  # fmt: skip


@pytest.mark.needs("minari")
def test_a_loaded_episode_is_the_collected_one_needs_minari(tmp_path):
    import minari

    source = Source(episodes=3, env="IrsNavRandom-v0", split="val", num_scenes=3)
    folder = write_dataset(source, "few-v0", tmp_path, progress=False)
    dataset = minari.MinariDataset(folder / "data")
    assert dataset.total_episodes == 3
    for number, loaded in enumerate(dataset):
        alone = collect(source, source.make_env(), number)
        assert loaded.actions.tolist() == alone.actions
        assert (
            loaded.infos["optimal_actions"].tolist()
            == np.stack(alone.infos["optimal_actions"]).tolist()
        )
        chosen = loaded.infos["optimal_actions"][np.arange(len(loaded.actions)), loaded.actions]
        assert chosen.all()
        steps = pairwise(loaded.infos["distance_to_go"].tolist())
        assert all(later < earlier for earlier, later in steps)
    again = dataset.recover_environment(eval_env=True)
    assert again.spec.kwargs["random_start"] is False
