"""`tables` and `markdown`: what `python -m eval speed` found, for the terminal and as a page."""

from dataclasses import dataclass
from typing import Any

from rich.table import Table

from eval.benchmark.timing import Rates, Spread

INTRODUCTION = """# Speed

Written by `python -m eval speed`. All contenders of a table take turns in one process, {rounds} rounds of about
{seconds:g} s each, so that whatever else the machine does meets them alike. Rates are medians over the rounds; a ratio
is that of the same round, and its median and quartiles are given. Actions are random, and drawn beforehand.
Environments are made by `gymnasium.make` and `gymnasium.make_vec` with the default arguments unless the name says
otherwise, and episodes that end are reset within the time taken: the check of the actions, the gathering of the
observations into new memory and the observations of ended episodes (`SAME_STEP`) are all in.

{machine}

## Bars

"""
NOTES = """
## What to know about the figures

- All infos that a row has are computed at each step, for every environment: by default the six keys that cost
  little, with `infos="all"` all eleven, with `infos=[]` none.
- "bare np.take" gathers the same rows of observations into one buffer that is used again and again, and does nothing
  else: no environment that looks its observations up can be faster.
- CartPole computes a few numbers where IrsNav looks up {width} for each observation; its episodes are shorter, so it
  is reset more often, and each reset is in its time.
- EnvPool and the JAX environments may use all cores. Navix and Jumanji are timed in their best case, as compiled
  loops of 16 steps with nothing of Python in between.
- A run of Dijkstra's algorithm is needed once for each goal; distances are kept for the latest eight goals.
"""


@dataclass(frozen=True)
class Rows:
    """A table: its title, the heads of its columns, and its cells."""

    title: str
    heads: tuple[str, ...]
    cells: list[tuple[str, ...]]
    note: str = ""

    def for_terminal(self) -> Table:
        """The table for `rich`."""
        table = Table(title=self.title, caption=self.note or None)

        for n, head in enumerate(self.heads):
            table.add_column(head, justify="right" if n else "left")

        for row in self.cells:
            table.add_row(*row)

        return table

    def for_page(self) -> str:
        """The table in Markdown, without its title."""
        rows = [self.heads, ("---", *("---:" for _ in self.heads[1:])), *self.cells]
        note = f"\n{self.note}\n" if self.note else ""
        return "".join(f"| {' | '.join(row)} |\n" for row in rows) + note


def markdown(results: dict[str, Any]) -> str:
    """The page."""
    bars, *others = tables(results)
    page = INTRODUCTION.format(**results["settings"], machine=_machine(results)) + bars.for_page()

    for each in others:
        page += f"\n## {each.title}\n\n{each.for_page()}"

    return page + NOTES.format(**results)


def tables(results: dict[str, Any]) -> list[Rows]:
    """The bars, then a table for each race, then one for each kind of cost."""
    verdicts = {True: "met", False: "missed", None: "not measured"}
    bars = [
        (each["what"], each["needed"], each["measured"], verdicts[each["is_met"]])
        for each in results["bars"]
    ]
    races = [_race_rows(title, each) for title, each in results["races"].items()]
    costs = [_cost_rows(kind, each) for kind, each in results["costs"].items()]

    return [Rows("Bars", ("", "needed", "measured", "verdict"), bars), *races, *costs]


def _race_rows(title: str, found: dict[str, Any]) -> Rows:
    rates = Rates(found["rates"])
    ours, *_ = rates.by_name
    cells = [
        (
            name,
            _rate(rates.of(name).median),
            "" if name == ours else _times(rates.ratio(ours, name)),
        )
        for name in rates.by_name
    ]
    left_out = ", ".join(
        f"{name} (no package {package})" for name, package in found["left_out"].items()
    )
    note = f"Left out: {left_out}." if left_out else ""

    return Rows(title.capitalize(), ("", "steps/s", f"{ours} is faster by"), cells, note)


def _cost_rows(kind: str, found: list[dict[str, Any]]) -> Rows:
    counts_runs = any(each["dijkstra_runs"] is not None for each in found)
    cells = []

    for each in found:
        time = Spread(**each["seconds"])
        row = (each["what"], f"{_time(time.median)} ({_time(time.low)} to {_time(time.high)})")
        cells.append((*row, f"{each['dijkstra_runs']:g}") if counts_runs else row)

    return Rows(kind.capitalize(), ("", "time", "Dijkstra runs")[: 2 + counts_runs], cells)


def _machine(results: dict[str, Any]) -> str:
    machine = results["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return (
        f"Machine: {machine['cpu']}, {machine['cores']} cores, load {machine['load_before']:.1f} before and "
        f"{machine['load_after']:.1f} after. Versions: {versions}. Commit: {results['commit'] or 'unknown'}."
    )


def _rate(rate: float) -> str:
    """A rate with three digits and its unit's prefix."""
    for factor, prefix in ((1e6, " M"), (1e3, " k")):
        if rate >= factor:
            return f"{rate / factor:#.3g}".rstrip(".") + prefix

    return f"{rate:.3g}"


def _time(seconds: float) -> str:
    """A time with three digits and its unit."""
    for factor, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= factor:
            return f"{seconds / factor:#.3g}".rstrip(".") + f" {unit}"

    return f"{seconds / 1e-6:.3g} µs"


def _times(ratio: Spread) -> str:
    return f"{ratio.median:.3g} x ({ratio.low:.3g} to {ratio.high:.3g})"
