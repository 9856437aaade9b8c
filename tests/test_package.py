"""Facts of the package as it is installed: its version, its marker, and what importing it brings
along.
"""

import re
import subprocess
import sys
from importlib import import_module, metadata
from importlib.resources import files
from pathlib import Path

import gymnasium
import gymnasium.vector
import pytest

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
    imported = set(
        subprocess.run(report, check=True, capture_output=True, text=True).stdout.split()
    )
    assert "irs_gym" in imported
    assert not {"matplotlib", "pygame", "sb3_contrib", "stable_baselines3", "torch"} & imported


def test_flat_id_is_the_other_with_flat_observations():
    made = (
        gymnasium.make("irs_gym:IrsNavFlat-v0"),
        gymnasium.make("irs_gym:IrsNav-v0", observation="flat"),
    )
    assert made[0].unwrapped.task == made[1].unwrapped.task


def test_flat_vector_env_is_of_the_same_space():
    many = gymnasium.make_vec("irs_gym:IrsNavFlat-v0", num_envs=3)
    assert (
        many.single_observation_space == gymnasium.make("irs_gym:IrsNavFlat-v0").observation_space
    )


# --- Gymnasium before 1.1, which knows no autoreset mode ------------------------------------------

STEP_ONCE = """
import gymnasium
import gymnasium.vector

if hasattr(gymnasium.vector, "AutoresetMode"):
    del gymnasium.vector.AutoresetMode

env = gymnasium.make("irs_gym:{id}", **{arguments})
env.reset(seed=0)
env.step(0)
"""


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [("IrsNav-v0", {}), ("IrsNavRandom-v0", {"scenes": str(ROOT / "irs_gym" / "scenes")})],
)
def test_single_envs_need_no_autoreset_mode(env_id, arguments):
    step_once = STEP_ONCE.format(id=env_id, arguments=arguments)
    done = subprocess.run(
        [sys.executable, "-c", step_once], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_many_at_once_say_which_gymnasium_they_need(monkeypatch):
    monkeypatch.delattr(gymnasium.vector, "AutoresetMode", raising=False)
    monkeypatch.delitem(sys.modules, "irs_gym.mdp.autoreset", raising=False)
    with pytest.raises(
        ImportError, match=r"need gymnasium>=1\.1, and this is [0-9.]+: put single environments"
    ):
        import_module("irs_gym.mdp.autoreset")
