"""Facts about `python -m eval speed`: what it counts, compares and writes."""

import json

import pytest

from eval.benchmark import costs, timing
from eval.benchmark.costs import EventCost
from eval.benchmark.timing import Rates, Spread
from eval.commands import speed


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still unless it is set forward."""
    time = [0.0]
    monkeypatch.setattr(timing, "perf_counter", lambda: time[0])
    return time


def contender(clock, seconds_per_call, transitions_per_call=1):
    def steps(calls):
        clock[0] += calls * seconds_per_call
        return calls * transitions_per_call

    return steps


def test_rates_are_transitions_per_second_in_chunks_of_the_time_asked_for(clock):
    fast, slow = contender(clock, 0.25, transitions_per_call=8), contender(clock, 0.5)
    rates = timing.time_in_turns({"fast": fast, "slow": slow}, rounds=3, seconds=2.0)
    began = clock[0]
    assert rates.by_name == {"fast": [32.0] * 3, "slow": [2.0] * 3}
    assert rates.ratio("fast", "slow") == Spread(16.0, 16.0, 16.0)
    timing.time_in_turns({"fast": fast}, rounds=10, seconds=2.0)
    assert clock[0] - began == pytest.approx(10 * 1.25 * 2.0, abs=2 * 2.0)


def test_ratios_are_taken_round_by_round():
    rates = Rates({"ours": [10.0, 40.0, 30.0], "other": [5.0, 10.0, 10.0]})
    assert rates.ratio("ours", "other") == Spread(3.0, 2.5, 3.5)
    assert rates.of("ours").median == 30.0


@pytest.mark.parametrize(("rounds", "seconds"), [(0, 1.0), (1, 0.0)])
def test_a_race_without_rounds_or_time_is_refused(rounds, seconds):
    with pytest.raises(ValueError, match="must be positive"):
        timing.time_in_turns({}, rounds, seconds)


def test_only_a_reset_to_a_new_goal_runs_dijkstra():
    found = {cost.what: cost.dijkstra_runs for cost in costs.resets(repeats=20)}
    assert found.pop(speed.NEW_GOAL) == 1
    assert len(found) == 4
    assert set(found.values()) == {0}


def test_a_bar_is_met_missed_or_not_measured():
    rates = {title: Rates({"IrsNav-v0": [3.0]}) for title in speed.RACES}
    rates["one environment"].by_name["CartPole-v1"] = [2.0]  # exactly what is needed
    rates["64 environments"].by_name["CartPole-v1"] = [1.21]
    bars = speed.judge(
        rates,
        [
            EventCost("import irs_gym", Spread(0.6, 0.5, 0.7)),
            EventCost("a new start", Spread(1, 1, 1), 0.5),
        ],
    )
    verdicts = {bar.what: bar.is_met for bar in bars}
    assert verdicts["one environment: IrsNav-v0 over CartPole-v1"] is True
    assert verdicts["64 environments: IrsNav-v0 over CartPole-v1"] is False
    assert verdicts["one environment: IrsNav-v0 over Minigrid Empty-16x16"] is None
    assert verdicts["import irs_gym"] is False
    assert verdicts["Dijkstra runs of a reset to a goal used before"] is False


def test_command_writes_a_page_and_its_data(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(costs, "CELL_SIZES", (0.5,))  # the fine map takes seconds
    status = speed.main(out=tmp_path / "new", rounds=1, seconds=0.001, repeats=5)
    results = json.loads((tmp_path / "new" / "speed.json").read_text())
    page = (tmp_path / "new" / "speed.md").read_text()
    assert status == any(bar["is_met"] is False for bar in results["bars"])
    assert len(results["bars"]) == 15
    for bar in results["bars"]:
        assert f"| {bar['what']} | {bar['needed']} | {bar['measured']} |" in page
    for title, found in results["races"].items():
        assert set(found["rates"]) | set(found["left_out"]) == set(speed.RACES[title])
        assert all(name in page for name in found["left_out"])
    assert "188" in page  # values of an observation
    assert "Bars" in capsys.readouterr().out


def test_command_refuses_what_it_cannot_time(capsys, tmp_path):
    assert speed.main(out=tmp_path / "new", repeats=0) == 2
    assert "repeats=0" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
