"""Facts of `python -m irs_gym.workbench`: what it listens to, whom it lends the page, and what it
says where something is missing.
"""

import sys

import pytest

from irs_gym.workbench import __main__ as command
from irs_gym.workbench.policy_paths import GROUP, installed_policies


def run(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["workbench", *arguments])
    return command.main()


def test_it_listens_on_this_machine_alone_unless_told_otherwise():
    assert command.parser().parse_args([]).address == "127.0.0.1"


def test_pages_of_other_sites_may_not_use_it(monkeypatch):
    served = {}
    monkeypatch.setattr(command, "_serve", lambda *given, **_: served.update(given=given) or 0)
    assert run(monkeypatch, "--port", "5006") == 0
    assert served["given"][2:5] == ("127.0.0.1", 5006, ["127.0.0.1:5006", "localhost:5006"])
    assert run(monkeypatch, "--port", "5006", "--address", "10.0.0.7", "--origin", "lab:80") == 0
    assert served["given"][4] == ["10.0.0.7:5006", "lab:80"]


def test_port_0_is_one_that_is_free(monkeypatch):
    served = {}
    monkeypatch.setattr(command, "_serve", lambda *given, **_: served.update(given=given) or 0)
    run(monkeypatch)
    port = served["given"][3]
    assert port > 0
    assert served["given"][4][0] == f"127.0.0.1:{port}"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--scene", "nowhere.json"], "scene='nowhere.json' is neither a file nor one of"),
        (["--folder", "/nowhere"], "folder='/nowhere' is no folder"),
    ],
)
def test_what_is_not_there_is_said_in_a_line(monkeypatch, capsys, arguments, why):
    assert run(monkeypatch, *arguments) == 2
    assert capsys.readouterr().err.startswith(f"python -m irs_gym.workbench: {why}")


def test_without_panel_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "panel", None)
    assert run(monkeypatch) == 2
    said = capsys.readouterr().err
    assert said.startswith("python -m irs_gym.workbench: ")
    assert "pip install 'irs_gym[workbench]'" in said
    assert said.count("\n") == 1


def test_a_policy_whose_package_is_not_there_is_left_out(monkeypatch):
    from importlib.metadata import EntryPoint

    entries = [
        EntryPoint("planner", "agents.runs.pretrained_path:planner_path", GROUP),
        EntryPoint("gone", "no_such_package.path:path", GROUP),
        EntryPoint("moved", "agents.no_such_module:path", GROUP),
    ]
    monkeypatch.setattr("irs_gym.workbench.policy_paths.entry_points", lambda group: entries)
    assert list(installed_policies()) == ["planner"]
