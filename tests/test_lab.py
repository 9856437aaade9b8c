"""Facts of `irs-gym`: trainers, scores and pretrained agents from any folder, of a checkout here.

`.ci/check_wheel.py` holds the same of a wheel that is installed alone.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import irs_gym
from irs_gym import lab

ROOT = Path(irs_gym.__file__).resolve().parents[1]


def run(code: str, folder: Path) -> subprocess.CompletedProcess:
    """Run Python code in a folder, where `irs_gym` alone can be imported."""
    found = f"import sys; sys.path.insert(0, {str(folder / 'site')!r}); {code}"
    settings = {"PYTHONPATH": "", "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, "-c", found],
        cwd=folder,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def installed(tmp_path) -> Path:
    """A folder with the package as a wheel lays it out, its parts linked."""
    package = tmp_path / "site" / "irs_gym"
    (package / "_lab").mkdir(parents=True)
    for each in (ROOT / "irs_gym").iterdir():
        (package / each.name).symlink_to(each)
    (package / "lab.py").unlink()
    (package / "lab.py").write_text((ROOT / "irs_gym" / "lab.py").read_text())
    for name in ("agents", "train", "eval", "models"):
        (package / "_lab" / name).symlink_to(ROOT / name)
    return tmp_path


def test_in_a_checkout_the_lab_is_the_checkout():
    assert lab.folder() == ROOT


def test_the_lab_of_an_installed_package_lies_below_it(installed):
    done = run("import irs_gym.lab; print(irs_gym.lab.folder())", installed)
    assert done.stdout.strip() == str(installed / "site" / "irs_gym" / "_lab")


def test_opened_it_is_there_for_processes_too(installed):
    code = (
        "import os, irs_gym.lab; irs_gym.lab.open_lab(); irs_gym.lab.open_lab();"
        "import agents; print(agents.__file__, os.environ['PYTHONPATH'])"
    )
    where = installed / "site" / "irs_gym" / "_lab"
    assert run(code, installed).stdout.split() == [
        str(where / "agents" / "__init__.py"),
        str(where),
    ]


def test_what_is_someone_elses_is_not_taken_for_it(installed):
    (installed / "site" / "agents").mkdir()
    (installed / "site" / "agents" / "__init__.py").write_text("")
    done = run("import irs_gym.lab; irs_gym.lab.open_lab()", installed)
    assert (
        done.stderr.strip()
        .splitlines()[-1]
        .startswith("ImportError: the package 'agents' that is found is not irs_gym's")
    )


@pytest.mark.parametrize(("words", "status"), [([], 0), (["--help"], 0), (["fly"], 2)])
def test_commands_are_told(words, status, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["irs-gym", *words])
    assert lab.main() == status
    assert (
        capsys.readouterr().out == "usage: irs-gym {train,eval,convert,proof,workbench} [--help]\n"
    )


def test_a_command_is_that_of_its_module(installed):
    code = "sys.argv = ['irs-gym', 'convert', '--help']; from irs_gym.lab import main; main()"
    done = run(code, installed)
    assert done.returncode == 0
    assert "floor plan" in done.stdout
