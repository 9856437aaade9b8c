"""`tables` and `speed_page`: what `python -m eval speed` found, for the terminal and as a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from eval.benchmark.timing import Rates, Spread
from eval.markdown import template


@dataclass(frozen=True)
class Rows:
    """A table: its title, the heads of its columns, and its cells."""

    title: str
    heads: tuple[str, ...]
    cells: Sequence[tuple[str, ...]]
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
        # a colon aligns the numbers of a column to the right
        rows = [self.heads, ("---", *("---:" for _ in self.heads[1:])), *self.cells]
        note = f"\n\n{self.note}" if self.note else ""
        return "\n".join(f"| {' | '.join(row)} |" for row in rows) + note


def speed_page(results: dict[str, Any]) -> str:
    """The page of the results (see `eval.commands.speed`)."""
    bars, *others = tables(results)
    return template("speed.md").format(
        **results["settings"],
        machine=_machine(results),
        bars=bars.for_page(),
        tables="\n\n".join(f"## {each.title}\n\n{each.for_page()}" for each in others),
        width=results["width"],
    )


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
    heads = ("", "time", "Dijkstra runs") if counts_runs else ("", "time")
    cells: list[tuple[str, ...]] = []

    for each in found:
        time = Spread(**each["seconds"])
        shown = f"{_time(time.median)} ({_time(time.low)} to {_time(time.high)})"
        runs = (f"{each['dijkstra_runs']:g}",) if counts_runs else ()
        cells.append((each["what"], shown, *runs))

    return Rows(kind.capitalize(), heads, cells)


def _machine(results: dict[str, Any]) -> str:
    machine = results["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return (
        f"Machine: {machine['cpu']}, {machine['cores']} cores, "
        f"load {machine['load_before']:.1f} before and {machine['load_after']:.1f} after. "
        f"Versions: {versions}. Commit: {results['commit'] or 'unknown'}."
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
