"""Facts of the registry: every string of every row names what it should, settings are plain data,
and a new algorithm is one new file and one row.
"""

import json
import sys
from dataclasses import fields, is_dataclass, replace
from inspect import signature
from shlex import split
from typing import get_args

import pytest
from evaluating import call as evaluate
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from tiny import call, open_floor
from tiny_pool import tiny_pool

from agents.registry import (
    ALGORITHMS,
    Row,
    config_class,
    drivers,
    generalists,
    learner_class,
    named,
    network_class,
    observation_of,
    specialists,
)
from agents.runs.run_folder import Run
from eval.commands.pretrain import Kept
from eval.unseen import scores as unseen_scores
from irs_gym.datasets import scene_set, splits
from train.config import defaults_of
from train.plan import Plan, PlanError

IN_ONE_SCENE = '''
"""A table that learns nothing, and goes where its settings say."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.q_learning import QLearning, QLearningConfig


@dataclass(frozen=True, kw_only=True)
class ToyConfig(QLearningConfig):
    """Settings of the toy."""

    algorithm: ClassVar[str] = "toy"

    total_timesteps: int = 64
    n_envs: int = 4
    favourite: int = 0
    """The action that it likes."""


class Toy(QLearning):
    """Always takes one action."""

    @classmethod
    def build(cls, config, env, seed):
        model = super().build(config, env, seed)
        model.table[:, config.favourite] = 1e9
        return model
'''
ON_MANY_SCENES = '''
"""A network of one layer that is taught nothing."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from torch import nn

from agents.networks.map_network import MapPlan


@dataclass(frozen=True, kw_only=True)
class ToyConfig:
    """Settings of the toy."""

    algorithm: ClassVar[str] = "toy"
    network_settings: ClassVar[tuple[str, ...]] = ("side",)

    weights: Path | None = None
    """A network to begin with."""
    total_timesteps: int = 40
    """Scenes seen."""
    side: int = 3
    """Cells on each side of the convolution."""


class ToyNetwork(nn.Module):
    """A convolution."""

    def __init__(self, side):
        super().__init__()
        self.moves = nn.Conv2d(3, 8, side, padding=side // 2)

    def forward(self, maps):
        return MapPlan(self.moves(maps), maps[:, 2])


class Toy:
    """Looks at ten scenes and learns nothing."""

    def __init__(self, config, network, rng):
        self.network = network

    def update(self, pool, progress):
        return 10, {"loss": 0.0}
'''


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_string_of_a_row_names_what_it_should(name):
    row = ALGORITHMS[name]
    learner = learner_class(name)
    assert config_class(name).algorithm == name
    if row.is_sb3:
        assert learner.policy_aliases
        assert row.network is None or issubclass(named(row.network), BaseFeaturesExtractor)
    elif row.is_taught:
        assert list(signature(learner).parameters) == ["config", "network", "rng"]
        assert network_class(row.network_name) is named(row.network)
        wanted = signature(named(row.network)).parameters
        assert config_class(name).network_settings == tuple(wanted)
    else:
        assert list(signature(learner.build).parameters) == ["config", "env", "seed"]
        if row.mixes:
            assert named(row.mixes).policy_aliases
        else:
            assert list(signature(learner.of).parameters) == ["arrays", "shape", "actions"]


@pytest.mark.parametrize("name", ALGORITHMS)
def test_settings_are_frozen_data_of_two_classes_at_most_that_make_no_learner(name):
    config = config_class(name)
    chain = [each for each in config.__mro__ if is_dataclass(each)]
    assert config.__mro__ == (*chain, object)
    assert len(chain) <= 2
    assert all(each.__dataclass_params__.frozen for each in chain)
    public = {each for each in dir(config) if not each.startswith("_")}
    own = {each.name for each in fields(config)}
    plain = {"algorithm", "network_settings", "policy", "policy_settings", "env_settings"}
    assert public - own - plain <= {"total_timesteps", "terms"}  # of fields under other names


@pytest.mark.parametrize("name", ALGORITHMS)
def test_defaults_of_runs_are_those_of_the_row(name):
    row, default = ALGORITHMS[name], defaults_of(name)
    assert default.agent == config_class(name)()
    assert {each: getattr(default, each) for each in row.training} == row.training
    assert {each: getattr(default.env, each) for each in row.env} == row.env


def test_each_algorithm_learns_in_one_scene_or_on_many():
    assert (*specialists(), *drivers(), *generalists()) == tuple(
        ALGORITHMS
    )  # in the order of command lines
    assert {observation_of(name) for name in generalists()} == {"flat", "map"}
    assert len({row.title for row in ALGORITHMS.values()}) == len(ALGORITHMS)


def test_unknown_algorithm_in_a_sweep_is_answered_by_all_that_there_are(tmp_path):
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('out = "x"\nseeds = 1\nalgorithms = ["pppo"]\n[settings.one]\n')
    with pytest.raises(
        PlanError, match=r"algorithms.0: Input should be 'ppo', .* or 'recurrent_ppo'"
    ):
        Plan.load(sweep)


def test_pretrained_models_are_kept_of_all_but_tables_mixtures_and_headings():
    others = {"q_learning", "ppo_lagrangian", *drivers()}
    assert set(get_args(Kept)) == set(ALGORITHMS) - others


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Add an algorithm ``toy``: its file, and its row."""

    def add(text, row):
        (tmp_path / "toy_file.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "toy_file", raising=False)
        monkeypatch.setitem(ALGORITHMS, "toy", row)

    return add


def test_new_algorithm_in_one_scene_is_one_file_and_one_row(tmp_path, monkeypatch, capsys, toy):
    toy(
        IN_ONE_SCENE,
        Row(
            title="toy",
            track="scene",
            config="toy_file:ToyConfig",
            learner="toy_file:Toy",
            env={"random_start": 0.25},
        ),
    )
    assert call(["--help"]) == 0
    assert ",toy,sweep,dataset,scenes}" in capsys.readouterr().out
    assert call(["toy", "--help"]) == 0
    assert "The action that it likes." in capsys.readouterr().out

    words = [*open_floor(tmp_path), *split("--agent.favourite 1 --eval-every 16 --no-progress")]
    assert call(["toy", "--out", tmp_path / "run", *words]) == 0
    run = Run.open(tmp_path / "run")
    assert run.config.env["random_start"] == 0.25
    assert run.config.agent["favourite"] == 1
    policy = run.load_model()
    assert (policy.table.argmax(axis=1) == 1).mean() > 0.5  # nothing was learned where it was not

    assert evaluate(monkeypatch, "score", tmp_path / "run", "--episodes", "2") == 0
    scores = json.loads((tmp_path / "run" / "scores.json").read_text())["scores"]
    assert "toy" in [each["policy"] for each in scores]
    assert (
        evaluate(
            monkeypatch, "board", tmp_path / "run", "--out", tmp_path / "board", "--episodes", "2"
        )
        == 0
    )
    assert "toy" in (tmp_path / "board" / "scoreboard.md").read_text()


def test_new_algorithm_on_many_scenes_is_one_file_and_one_row(tmp_path, monkeypatch, capsys, toy):
    def build(split, num_scenes, **_):
        return tiny_pool(6, (8, 8), seed=len(split))

    for module in (scene_set, unseen_scores):
        monkeypatch.setattr(module, "build_scene_set", build)

    for name, each in splits.SPLITS.items():
        monkeypatch.setitem(splits.SPLITS, name, replace(each, frame=(8, 8)))

    toy(
        ON_MANY_SCENES,
        Row(
            title="toy",
            track="map",
            config="toy_file:ToyConfig",
            learner="toy_file:Toy",
            network="toy_file:ToyNetwork",
            training={"eval_every": 20},
        ),
    )
    assert call(["toy", "--help"]) == 0
    assert "Cells on each side of the convolution." in capsys.readouterr().out

    assert call(["toy", "--out", tmp_path / "run", "--agent.side", "5", "--no-progress"]) == 0
    run = Run.open(tmp_path / "run")
    assert run.config.training["eval_every"] == 20
    policy = run.load_model("last")
    assert (policy.name, policy.settings) == ("toy_file", {"side": 5})
    assert policy.network.moves.kernel_size == (5, 5)

    assert evaluate(monkeypatch, "score", tmp_path / "run", "--split", "val") == 0
    scores = json.loads((tmp_path / "run" / "unseen.json").read_text())["scores"]
    assert scores["val"]["all"]["scenes"] == 6

    again = ["toy", "--out", tmp_path / "again", "--agent.weights", tmp_path / "run"]
    assert call([*again, "--no-progress"]) == 2  # whose side is another
    assert "hold toy_file {'side': 5}, not toy_file {'side': 3}" in capsys.readouterr().err
