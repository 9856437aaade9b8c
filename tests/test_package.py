"""Facts of the package as it is installed: its version, its marker, and what importing it brings along."""

import re
import subprocess
import sys
from importlib import metadata
from importlib.resources import files
from pathlib import Path

import gymnasium

import irs_gym

ROOT = Path(__file__).resolve().parents[1]


def test_version_is_that_of_the_installed_distribution():
    assert irs_gym.__version__ == metadata.version("irs_gym")


def test_changelog_begins_with_this_version():
    entries = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert entries[0] == irs_gym.__version__


def test_citation_is_for_this_version():
    assert f"\nversion: {irs_gym.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def test_package_is_marked_as_typed():
    assert files("irs_gym").joinpath("py.typed").is_file()


def test_import_brings_no_plotting_training_or_window_package():
    report = [sys.executable, "-c", "import sys, irs_gym; print(*sys.modules)"]
    imported = set(subprocess.run(report, check=True, capture_output=True, text=True).stdout.split())
    assert "irs_gym" in imported
    assert not {"matplotlib", "pygame", "sb3_contrib", "stable_baselines3", "torch"} & imported


def test_flat_id_is_the_other_with_flat_observations():
    made = gymnasium.make("irs_gym:IrsNavFlat-v0"), gymnasium.make("irs_gym:IrsNav-v0", observation="flat")
    assert made[0].unwrapped.task == made[1].unwrapped.task
    many = gymnasium.make_vec("irs_gym:IrsNavFlat-v0", num_envs=3)
    assert many.single_observation_space == made[0].observation_space
