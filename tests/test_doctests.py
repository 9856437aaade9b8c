"""Facts of the examples in docstrings: each public name has one, and they hold."""

import doctest
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import irs_gym

ROOT = Path(__file__).resolve().parents[1]

# What a package's modules need beside its own code.
NEEDS = {"irs_gym": [], "agents": ["torch"], "train": ["torch"], "eval": ["torch"]}
WITH_EXAMPLES = [
    pytest.param(
        ".".join(each.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"),
        marks=[pytest.mark.needs(*needed)] if needed else [],
    )
    for package, needed in NEEDS.items()
    for each in sorted(ROOT.glob(f"{package}/**/*.py"))
    if ">>> " in each.read_text()
]


def failures(module: ModuleType) -> int:
    """Number of the examples that do not hold; the output tells which."""
    return doctest.testmod(module).failed


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_a_module_hold(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert failures(import_module(name)) == 0


def test_every_public_name_has_an_example():
    names = set(irs_gym.__all__) - {"__version__"}
    assert {name for name in names if ">>> " not in (getattr(irs_gym, name).__doc__ or "")} == set()


def test_an_example_that_does_not_hold_is_seen():
    module = ModuleType("wrong")
    module.__doc__ = ">>> 1 + 1\n3\n"
    assert failures(module) == 1
