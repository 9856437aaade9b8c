"""`python -m eval speed`: how fast the environments are beside others, on a page and as JSON."""

import json
import os
import sys
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.spaces import flatdim
from rich.console import Console

from agents.runs import provenance
from eval.benchmark import costs
from eval.benchmark.benchmark_envs import (
    CODEBOOK,
    CONTINUOUS,
    ID,
    PENDULUM,
    SINGLE,
    SYNC_PENDULUM,
    BenchmarkEnvs,
    prepare,
    vector,
)
from eval.benchmark.costs import EventCost
from eval.benchmark.local_policies import ANEW, REPLANNING, planners
from eval.benchmark.page import speed_page, tables
from eval.benchmark.timing import Rates, time_in_turns
from irs_gym.files import write_file

OURS = "IrsNav-v0"
PEERS = ("minigrid", "mobile-env", "envpool", "navix", "jumanji", "jax")
RACES: dict[str, BenchmarkEnvs] = {
    "one environment": SINGLE,
    "1,024 environments": vector(1024),
    "64 environments": vector(64),
    "a policy in one environment": planners(1),
    "a policy in 64 environments": planners(64),
}
# race, ours, contender, how many times its speed we say we reach
RATIOS = (
    ("one environment", OURS, "CartPole-v1", 1.5),
    ("one environment", OURS, "Minigrid Empty-16x16", 30.0),
    ("1,024 environments", OURS, "CartPole-v1", 1.8),
    ("1,024 environments", CODEBOOK, "CartPole-v1", 1.2),
    ("1,024 environments", OURS, "bare np.take", 0.3),
    ("64 environments", OURS, "CartPole-v1", 2.5),
    ("one environment", CONTINUOUS, PENDULUM, 1.0),
    ("1,024 environments", CONTINUOUS, SYNC_PENDULUM, 20.0),
    ("a policy in 64 environments", REPLANNING, ANEW, 10.0),
)
# race, ours, how many steps a second we say it makes
LEAST_RATES = (("1,024 environments", CONTINUOUS, 1e6),)
MOST_SECONDS = {
    "each frame after it": 0.010,
    "front of violations, 1,600 cells": 0.05,
    "front of deficits, 1,600 cells": 0.05,
    "front of violations, 160,000 cells": 10.0,
    "front of deficits, 160,000 cells": 10.0,
    "import irs_gym": 0.5,
}
NEW_GOAL = "a new start and a new goal"


@dataclass(frozen=True)
class Bar:
    """A speed that we say we reach; ``is_met`` is None where it was not measured."""

    what: str
    needed: str
    measured: str
    is_met: bool | None


def main(
    out: Path = Path("docs"), rounds: int = 15, seconds: float = 0.2, repeats: int = 200
) -> int:
    """Time the environments beside others and write speed.md and speed.json; fails where a bar is
    missed.

    Others that are not installed are left out: pip install -e ".[peers,peers-jax]" brings them.

    Parameters
    ----------
    out
        Folder of the page and its data.
    rounds
        Rounds in which every contender is timed once.
    seconds
        Time of each contender in a round.
    repeats
        Resets and frames that are timed.
    """
    try:
        results = measure_speeds(rounds, seconds, repeats)
    except ValueError as error:
        print(f"python -m eval speed: {error}", file=sys.stderr)
        return 2

    out.mkdir(parents=True, exist_ok=True)
    write_file(out / "speed.json", (json.dumps(results, indent=2, allow_nan=False) + "\n").encode())
    write_file(out / "speed.md", speed_page(results).encode())
    console = Console()

    for each in tables(results):
        console.print(each.for_terminal())

    print(f"written: {out / 'speed.md'}, {out / 'speed.json'}")

    return 1 if any(each["is_met"] is False for each in results["bars"]) else 0


def measure_speeds(rounds: int, seconds: float, repeats: int) -> dict[str, Any]:
    """All measurements and whether they meet the bars, as JSON holds them.

    Raises
    ------
    ValueError
        Where an argument is not positive.
    """
    if repeats < 1:
        raise ValueError(f"repeats={repeats} must be positive")

    load = os.getloadavg()[0]
    rates = {}
    left_out = {}

    for title, contenders in RACES.items():
        print(f"timing {title} ...", file=sys.stderr)
        ready, left_out[title] = prepare(contenders)
        rates[title] = time_in_turns(ready, rounds, seconds)

    print("timing resets, frames, fronts and imports ...", file=sys.stderr)
    found = {
        "resets": costs.resets(repeats),
        "frames": costs.frames(repeats),
        "Pareto fronts": costs.fronts(repeats),
        "imports": costs.imports(max(3, repeats // 20)),
    }

    return {
        "format_version": 1,
        "machine": {
            "cpu": provenance.processor(),
            "cores": os.cpu_count(),
            "load_before": load,
            "load_after": os.getloadavg()[0],
        },
        "versions": provenance.versions() | _peer_versions(),
        "commit": provenance.commit(),
        "width": flatdim(gymnasium.make(ID).observation_space),
        "settings": {"rounds": rounds, "seconds": seconds, "repeats": repeats},
        "races": {
            title: {"rates": rates[title].by_name, "left_out": left_out[title]} for title in RACES
        },
        "costs": {kind: [asdict(each) for each in some] for kind, some in found.items()},
        "bars": [
            asdict(each)
            for each in judge(rates, [cost for some in found.values() for cost in some])
        ],
    }


def judge(rates: dict[str, Rates], found: list[EventCost]) -> list[Bar]:
    """Each bar, and whether the median of the measurements meets it."""
    bars = []

    for title, ours, other, least in RATIOS:
        what = f"{title}: {ours} over {other}"
        needed = f"at least {least:g} x"
        if {ours, other} <= set(rates[title].by_name):
            ratio = rates[title].ratio(ours, other)
            measured = f"{ratio.median:.3g} x ({ratio.low:.3g} to {ratio.high:.3g})"
            bars.append(Bar(what, needed, measured, ratio.median >= least))
        else:
            bars.append(Bar(what, needed, "not measured", None))

    for title, ours, least in LEAST_RATES:
        what = f"{title}: {ours}"
        needed = f"at least {least:g} steps/s"
        if ours in rates[title].by_name:
            rate = rates[title].of(ours)
            measured = f"{rate.median:.3g} ({rate.low:.3g} to {rate.high:.3g})"
            bars.append(Bar(what, needed, measured, rate.median >= least))
        else:
            bars.append(Bar(what, needed, "not measured", None))

    for cost in found:
        if cost.what in MOST_SECONDS:
            most = MOST_SECONDS[cost.what]
            measured = f"{cost.seconds.median * 1e3:.3g} ms"
            bars.append(
                Bar(cost.what, f"under {most * 1e3:g} ms", measured, cost.seconds.median < most)
            )

    runs = sum(cost.dijkstra_runs or 0 for cost in found if cost.what != NEW_GOAL)
    bars.append(
        Bar("Dijkstra runs of a reset to a goal used before", "none", f"{runs:g}", runs == 0)
    )

    return bars


def _peer_versions() -> dict[str, str]:
    installed = {each.metadata["Name"].lower(): each.version for each in metadata.distributions()}
    return {name: installed[name] for name in PEERS if name in installed}
