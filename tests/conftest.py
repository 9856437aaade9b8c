"""What all tests share: a key of their own, and that those marked ``needs(package, ...)`` run where
it is installed.

Elsewhere they are left out, and named at the end.
"""

import os
import subprocess
import sys
from functools import cache
from importlib.util import find_spec

import pytest

LEFT_OUT = pytest.StashKey[list[str]]()


@pytest.fixture(scope="session", autouse=True)
def _own_key(tmp_path_factory):
    """So that none is made among the settings of whoever runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IRS_GYM_KEY", str(tmp_path_factory.mktemp("key") / "key"))
        yield


@cache
def is_there(need: str) -> bool:
    """Whether a package can be imported, or a variable of the environment (``$NAME``) is set."""
    if need.startswith("$"):
        return need[1:] in os.environ
    if find_spec(need.partition(".")[0]) is None:
        return False
    return not subprocess.run(
        [sys.executable, "-c", f"import {need}"], capture_output=True, check=False
    ).returncode


def missing(item: pytest.Item) -> list[str]:
    """What the test needs and is not there."""
    return [need for mark in item.iter_markers("needs") for need in mark.args if not is_there(need)]


def pytest_configure(config: pytest.Config) -> None:
    """Say what the marker means."""
    config.addinivalue_line(
        "markers",
        "needs(package, ...): runs where these are installed; see .ci/clients.py and .ci/workbench.py",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that need what is missing."""
    left_out = [item for item in items if missing(item)]
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=left_out)
    config.stash[LEFT_OUT] = [item.name for item in left_out]
    if hasattr(config, "workeroutput"):  # of xdist, where the workers alone collect
        config.workeroutput["left_out"] = config.stash[LEFT_OUT]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error) -> None:
    """Take over from a worker of xdist what it has left out."""
    node.config.stash[LEFT_OUT] = getattr(node, "workeroutput", {}).get("left_out", [])


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Name the tests that were left out."""
    names = config.stash.get(LEFT_OUT, [])
    if names:
        terminalreporter.write_line(
            f"deselected, since `make clients` or `make workbench` runs them: {', '.join(names)}"
        )
