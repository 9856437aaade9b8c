"""`as_png`: a figure of matplotlib as a PNG, small where 256 colours do; names in it, a legend
that fits, and `write_pictures`.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from PIL import Image

from eval.markdown import printable
from irs_gym.files import write_file


def as_png(figure: Figure, dpi: int = 150, *, in_palette: bool = False) -> bytes:
    """The figure as a PNG without date or version; a third of the size with a palette of 256
    colours.
    """
    content = BytesIO()
    # without the version of matplotlib: the same figure is the same file
    figure.savefig(content, format="png", dpi=dpi, metadata={"Software": None})
    if not in_palette:
        return content.getvalue()

    few = Image.open(content).convert("RGB").quantize(256, kmeans=1, dither=Image.Dither.NONE)
    content = BytesIO()
    few.save(content, format="png", optimize=True)

    return content.getvalue()


def write_pictures(folder: Path, pictures: Mapping[str, bytes]) -> None:
    """Write pictures by their names into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)

    for name, content in pictures.items():
        write_file(folder / name, content)


def literal(name: str) -> str:
    """The name, or its first hundred characters, as matplotlib shows them as they are, and not as a
    formula.
    """
    return printable(name if len(name) <= 100 else f"{name[:99]}…").replace("$", r"\$")


def add_legend(figure: Figure, handles: Sequence[Artist]) -> None:
    """A legend below the figure, in as many columns as its width has room for, up to four."""
    for each in handles:
        each.set_label(literal(str(each.get_label())))

    # All in characters of small print: 14 to the inch, and seven for the line or mark of a label.
    lengths = [len(str(each.get_label())) + 7 for each in handles]
    room = figure.get_figwidth() * 14

    # matplotlib fills column by column, and each is as wide as its longest label
    widths = {
        n: sum(max(part, default=0) for part in np.array_split(lengths, n)) for n in (4, 3, 2, 1)
    }
    columns = next((n for n, width in widths.items() if width <= room), 1)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize="small")
