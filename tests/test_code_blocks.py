"""Every block of code in the README and on the site's pages runs, in a copy of the checkout.

Comments in front of a block tell the test, and whoever reads the source, how it differs from the
text: `<!-- test: OLD -> NEW -->` replaces one place, `<!-- test: after COMMAND -->` runs a command
before it, `<!-- test: needs PACKAGE -->` leaves it to `make clients` where the package is missing. In bash blocks, `make` only says what it would do, and
`pip install` only whether it could.
"""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import pytest
import yaml
from _pytest.mark.structures import ParameterSet

from agents.single.dqn import DqnConfig
from agents.single.ppo import PpoConfig
from train.config import defaults_of

ROOT = Path(__file__).resolve().parents[1]
# The documents whose blocks are run. Notebooks run as the site is built, docstrings' examples in
# `test_doctests.py`; pages that commands write show no code but these commands.
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "docs" / "index.md",
    *sorted(ROOT.glob("docs/concepts/*.md")),
    *sorted(ROOT.glob("docs/guides/*.md")),
]
NOT_RUN = {"text", "bibtex", "{toctree}"}
SECONDS = 600
NEWLINE = "\n"
SHIMS = {
    "make": 'exec "$REAL_MAKE" --dry-run "$@"',
    "pip": """
        said=$(python -m pip "$@" --dry-run --no-build-isolation 2>&1) || { echo "$said"; exit 1; }
        ! grep "does not provide the extra" <<< "$said"
    """,
}


@dataclass(frozen=True)
class Block:
    """Fenced code, as it stands and as it is run."""

    place: str
    language: str
    code: str
    notes: tuple[str, ...]

    @property
    def after(self) -> list[str]:
        """Commands that are run before it."""
        return [note.removeprefix("after ") for note in self.notes if note.startswith("after ")]

    @property
    def needs(self) -> list[str]:
        """Packages, and variables of the environment as ``$NAME``, without which it is left out."""
        return [note.removeprefix("needs ") for note in self.notes if note.startswith("needs ")]

    @property
    def shortened(self) -> str:
        """The code with its replacements made; the same help is asked for once."""
        code = self.code
        for note in self.notes:
            if not note.startswith(("after ", "needs ")):
                old, new = note.split(" -> ")
                assert code.count(old) == 1, f"{self.place}: {old!r} is not there exactly once"
                code = code.replace(old, new)

        lines = code.splitlines(keepends=True)
        return "".join(
            line
            for n, line in enumerate(lines)
            if not (line.rstrip().endswith("--help") and line in lines[:n])
        )


def blocks(text: str, name: str = "") -> list[Block]:
    """All fenced blocks, with the comments right in front of them; their places begin with the
    document's name.
    """
    fence = re.compile(r"((?:^<!-- test: .+ -->\n)*)^```(.*)\n((?:.*\n)*?)^```$", re.MULTILINE)
    return [
        Block(
            place=f"{name}-line-{text.count(NEWLINE, 0, found.start(2)) + 1}",
            language=found[2],
            code=found[3],
            notes=tuple(re.findall(r"<!-- test: (.+) -->", found[1])),
        )
        for found in fence.finditer(text)
    ]


def run(block: Block, checkout: Path) -> subprocess.CompletedProcess:
    """Run the block as a user would who stands in the checkout."""
    commands = {
        "python": [sys.executable, "-c", block.shortened],
        "bash": ["bash", "-euo", "pipefail", "-c", block.shortened],
    }
    settings = {
        "PATH": os.pathsep.join(
            [str(checkout / ".shims"), str(Path(sys.executable).parent), os.environ["PATH"]]
        ),
        "PYTHONPATH": str(checkout),  # of processes that workers start
        "REAL_MAKE": shutil.which("make") or "make",
        "OMP_NUM_THREADS": "1",
        "SDL_VIDEODRIVER": "dummy",
        "RAY_AUTH_MODE": "disabled",
        "MINARI_DATASETS_PATH": str(checkout / ".minari"),
    }
    before = [["bash", "-euo", "pipefail", "-c", each] for each in block.after]
    for command in [*before, commands[block.language]]:
        done = subprocess.run(
            command,
            cwd=checkout,
            env=os.environ | settings,
            capture_output=True,
            text=True,
            check=False,
            timeout=SECONDS,
        )
        if done.returncode:
            break
    return done


@pytest.fixture(scope="session")
def checkout(tmp_path_factory) -> Path:
    """A copy of the checkout, with `make` and `pip` that change nothing."""
    copy = tmp_path_factory.mktemp("readme") / "irs_gym"
    hidden = shutil.ignore_patterns(".*", "__pycache__")

    def left_out(folder, names):
        outputs = {"runs", "build", "dist"} if Path(folder) == ROOT else set()
        return hidden(folder, names) - {".ci"} | outputs & set(names)  # .ci builds the wheel

    shutil.copytree(ROOT, copy, ignore=left_out)
    (copy / ".shims").mkdir()
    for name, script in SHIMS.items():
        (copy / ".shims" / name).write_text(f"#!/usr/bin/env bash\n{script}\n")
        (copy / ".shims" / name).chmod(0o755)
    return copy


RUNNABLE = [
    block
    for document in DOCUMENTS
    for block in blocks(document.read_text(), document.stem)
    if block.language not in NOT_RUN
]


def case(block: Block) -> ParameterSet:
    marks = [pytest.mark.needs(*block.needs)] if block.needs else []
    label = "-".join([block.place, block.language, *(f"needs_{need}" for need in block.needs)])
    return pytest.param(block, id=label, marks=marks)


@pytest.mark.parametrize("block", [case(block) for block in RUNNABLE])
def test_block_runs(block, checkout):
    done = run(block, checkout)
    assert done.returncode == 0, f"{block.place}:\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda each: each.stem)
def test_no_block_escapes(document):
    text = document.read_text()
    fences, found = re.findall(r"^\s*```", text, re.MULTILINE), blocks(text)
    assert len(fences) == 2 * len(found)
    assert {block.language for block in found} <= {"bash", "python", *NOT_RUN}
    assert len(re.findall(r"<!-- test: ", text)) == sum(len(block.notes) for block in found)


def test_a_broken_block_fails(checkout):
    assert (
        run(Block("here", "python", "import irs_gym\nirs_gym.fly()\n", ()), checkout).returncode
        == 1
    )
    assert run(Block("here", "bash", "false\ntrue\n", ()), checkout).returncode == 1
    assert run(Block("here", "bash", "make fly\n", ()), checkout).returncode == 2
    assert run(Block("here", "bash", 'pip install ".[fly]"\n', ()), checkout).returncode == 1
    assert run(Block("here", "bash", 'pip install ".[train]"\n', ()), checkout).returncode == 0
    assert run(Block("here", "bash", "true\n", ("after false",)), checkout).returncode == 1
    with pytest.raises(AssertionError, match="there: '3' is not there exactly once"):
        _ = Block("there", "python", "1 + 2\n", ("3 -> 4",)).shortened


@pytest.mark.parametrize("config", [PpoConfig(), DqnConfig()], ids=lambda config: config.algorithm)
def test_settings_for_rl_zoo3_are_those_of_train(config):
    zoo = yaml.safe_load((ROOT / "train" / "zoo" / f"{config.algorithm}.yml").read_text())[
        "IrsNavFlat-v0"
    ]
    assert zoo.pop("env_kwargs") == {"random_start": defaults_of(config.algorithm).env.random_start}
    assert zoo.pop("policy_kwargs") == f"dict(net_arch={list(config.net_arch)})"
    assert float(zoo.pop("learning_rate").removeprefix("lin_")) == config.learning_rate
    assert zoo.pop("n_timesteps") == config.total_timesteps
    assert zoo.pop("policy") == "MlpPolicy"
    others = {
        "total_timesteps",
        "net_arch",
        "learning_rate",
        "final_learning_rate",
        "final_ent_coef",
        "signs",
        "mask_head",
        "max_episode_steps",
    }
    assert config.max_episode_steps == gymnasium.spec("IrsNavFlat-v0").max_episode_steps
    assert zoo == {name: value for name, value in vars(config).items() if name not in others}
