"""`table`, `picture`, `Promise`: what the sections of a page are made of; `text`, `code`: names
from elsewhere in them; `template`: the words of a page around them.

Names come from run folders and sweep files, which anybody may have written: on a page they are
text, never markup.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class Promise:
    """Something that a page says holds."""

    text: str
    value: str
    is_met: bool


def template(name: str) -> str:
    """The text of a page in ``eval/templates``, with a field in braces for each part that is
    computed.
    """
    return (TEMPLATES / name).read_text(encoding="utf-8")


def template_sections(name: str) -> dict[str, str]:
    """The sections of a template by their titles, each with its heading."""
    found = re.split(r"^(?=##? )", template(name), flags=re.MULTILINE)
    return {each.partition("\n")[0].lstrip("# "): each for each in found if each}


def printable(name: str) -> str:
    """The name on one line, with an escape in place of each character that cannot be seen or
    encoded.
    """
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)


def text(name: str) -> str:
    """The name as Markdown that shows it as it is, also in a cell of a table."""
    # An underscore within a word is no markup, and reads better without a backslash.
    shown = re.sub(r"([\\`*\[\]|~]|(?<![^\W_])_|_(?![^\W_]))", r"\\\1", printable(name))
    return shown.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def code(name: str) -> str:
    """The name as code in Markdown, also in a cell of a table."""
    shown = printable(name).replace("|", "\\|")

    # The fence has one backtick more than the longest run of them in the name.
    longest = max(map(len, re.findall("`+", shown)), default=0)
    fence = "`" * (longest + 1)

    return f"{fence} {shown} {fence}" if longest else f"{fence}{shown}{fence}"


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [[str(cell) for cell in row] for row in (header, *rows)]
    first, *body = [
        "|" + "|".join(f" {cell} " if cell else " " for cell in line) + "|" for line in lines
    ]
    return "\n".join([first, "|" + "---|" * len(header), *body])


def picture(name: str, caption: str) -> str:
    """A figure, its caption, and links to its other forms."""
    links = f"[SVG](figures/{name}.svg), [data](figures/{name}.csv)"
    return f"![{name.replace('_', ' ')}](figures/{name}.png)\n\n*{caption}* ({links})"


def promises(items: Sequence[Promise]) -> str:
    """Promises as a table."""
    return table(
        ("promise", "measured", ""),
        [(p.text, p.value, "met" if p.is_met else "NOT MET") for p in items],
    )


def page(*parts: str) -> str:
    """Parts one below the other."""
    return "\n\n".join(part.strip() for part in parts if part) + "\n"
