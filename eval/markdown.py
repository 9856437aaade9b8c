"""`table`, `picture`, `Promise`: what the sections of a page are made of."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Promise:
    """Something that a page says holds."""

    text: str
    value: str
    is_met: bool


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [[str(cell) for cell in row] for row in (header, *rows)]
    first, *body = ["|" + "|".join(f" {cell} " if cell else " " for cell in line) + "|" for line in lines]
    return "\n".join([first, "|" + "---|" * len(header), *body])


def picture(name: str, caption: str) -> str:
    """A figure, its caption, and links to its other forms."""
    links = f"[SVG](figures/{name}.svg), [data](figures/{name}.csv)"
    return f"![{name.replace('_', ' ')}](figures/{name}.png)\n\n*{caption}* ({links})"


def promises(items: Sequence[Promise]) -> str:
    """Promises as a table."""
    return table(("promise", "measured", ""), [(p.text, p.value, "met" if p.is_met else "NOT MET") for p in items])


def page(*parts: str) -> str:
    """Parts one below the other."""
    return "\n\n".join(part.strip() for part in parts if part) + "\n"
