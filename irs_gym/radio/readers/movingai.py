"""`read_movingai_map`, `read_movingai_scenarios`: grids of the MovingAI benchmarks, and tasks on
them with the lengths that are published.

Sturtevant, Benchmarks for Grid-Based Pathfinding, 2012. In the files y runs downwards; here, as
everywhere, cell (0, 0) is at the lower left.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irs_gym.files import as_path, read_file
from irs_gym.grid import Cell, Grid, checked_cell_size
from irs_gym.memory import freeze
from irs_gym.radio.readers.floor_plan import CEILING, FloorPlan, check_cells, plan_of_cells
from irs_gym.radio.shapes import MOST_RASTER_CELLS

# Swamp can be entered from ground; water can be crossed, but not entered from there.
GROUND = b".GS"
WATER = b"W"
BLOCKED = b"@OT"
_SCEN_BYTES = 2**26
_FIELDS = 9  # of a scenario


@dataclass(frozen=True, eq=False)
class MovingAiMap:
    """What a map file holds: a letter a cell, ``S1``, shape ``(X, Y)``."""

    letters: NDArray[np.bytes_]

    def __post_init__(self) -> None:
        freeze(self.letters)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells (X, Y)."""
        return self.letters.shape[0], self.letters.shape[1]

    def free_from(self, cell: Cell | None = None) -> NDArray[np.bool_]:
        """The cells that can be entered on ways from a cell, by default ground: ``(X, Y)``."""
        is_water = np.asarray(self.letters == WATER)
        if cell is not None and is_water[cell]:
            return is_water

        return np.isin(self.letters, [bytes([letter]) for letter in GROUND])


@dataclass(frozen=True)
class MovingAiScenario:
    """A task on a map, and the length of its shortest path in cells, without corner cutting, as it
    is printed.

    Examples
    --------
    >>> scenario = MovingAiScenario("arena.map", (49, 49), (1, 37), (4, 36), "3.41421")
    >>> scenario.length
    3.41421
    """

    map_name: str
    shape: tuple[int, int]
    start: Cell
    goal: Cell
    printed: str

    @property
    def length(self) -> float:
        """The printed length."""
        return float(self.printed)


def read_movingai_map(
    path: str | Path, cell_size: float = 1.0, height: float = CEILING
) -> FloorPlan:
    r"""Floor plan of a ``.map`` file of the MovingAI benchmarks; water is blocked.

    Parameters
    ----------
    path
        Of the file.
    cell_size
        Edge of its cells in metres.
    height
        Of the ceiling and of all that is blocked, in metres.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    ValueError
        Where it is damaged, or too large; the message names file and field.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "hall.map"
    ...     _ = file.write_text("type octile\nheight 2\nwidth 3\nmap\n..@\n.T.\n")
    ...     read_movingai_map(file).data["obstacles"][0]["rows"]
    ['..#', '.#.']
    """
    place = as_path(path, "path")
    return plan_of_map(place.stem, load_movingai(place), cell_size, height)


def plan_of_map(
    name: str,
    grid: MovingAiMap,
    cell_size: float,
    height: float,
    scenario: MovingAiScenario | None = None,
) -> FloorPlan:
    """Floor plan of a map, with start and goal of a scenario on it where one is given."""
    cell_size = checked_cell_size(cell_size)
    tiles = Grid(grid.shape, cell_size, (0.0, 0.0))
    ends = {} if scenario is None else {"start": scenario.start, "goal": scenario.goal}
    points = {field: list(tiles.centre(cell)) for field, cell in ends.items()}
    start = None if scenario is None else scenario.start

    return plan_of_cells(name, ~grid.free_from(start), cell_size, tiles.origin, height, **points)


def load_movingai(path: Path) -> MovingAiMap:
    """The letters of a map file; errors are those of `read_movingai_map`."""
    name = str(path)
    lines = _text(path, 2 * MOST_RASTER_CELLS).splitlines()
    header = [line.split() for line in lines[:4]]
    if len(header) < 4 or header[0] != ["type", "octile"] or header[3] != ["map"]:
        raise ValueError(
            f"{name}: its first lines must be 'type octile', 'height', 'width' and 'map'"
        )

    rows = _count(name, "height", header[1])
    columns = _count(name, "width", header[2])
    check_cells(name, columns, rows)
    drawn = lines[4 : 4 + rows]
    if len(drawn) < rows:
        raise ValueError(f"{name}: height is {rows}, but there are {len(drawn)} rows")

    for n, row in enumerate(drawn):
        if len(row) != columns:
            raise ValueError(f"{name}: row {n} has {len(row)} cells, and width is {columns}")

    letters = np.frombuffer("".join(drawn).encode("latin-1", "replace"), dtype="S1")
    known = np.isin(letters, [bytes([letter]) for letter in GROUND + WATER + BLOCKED])
    if not known.all():
        n = int(np.argmin(known))
        strange = drawn[n // columns][n % columns]
        raise ValueError(f"{name}: row {n // columns} holds {strange!r}, no letter of such a map")

    return MovingAiMap(np.ascontiguousarray(letters.reshape(rows, columns)[::-1].T))


def read_movingai_scenarios(path: str | Path) -> tuple[MovingAiScenario, ...]:
    r"""The tasks of a ``.scen`` file.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    ValueError
        Where it is damaged; the message names file and line.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "hall.map.scen"
    ...     _ = file.write_text("version 1\n0 hall.map 3 2 0 0 2 1 2.41421\n")
    ...     read_movingai_scenarios(file)[0].goal  # y runs downwards in the file
    (2, 0)
    """
    place = as_path(path, "path")
    lines = _text(place, _SCEN_BYTES).splitlines()
    first = 1 if lines and lines[0].split()[:1] == ["version"] else 0

    return tuple(
        _scenario(f"{place}: line {n + 1}", line)
        for n, line in enumerate(lines)
        if n >= first and line.strip()
    )


def _scenario(where: str, line: str) -> MovingAiScenario:
    fields = line.split("\t") if "\t" in line else line.split()
    if len(fields) != _FIELDS:
        raise ValueError(f"{where} has {len(fields)} fields, not {_FIELDS}")

    try:
        columns, rows, *ends = (int(each) for each in fields[2:8])
        printed = fields[8].strip()
        is_length = 0 <= float(printed) < np.inf
    except ValueError:
        raise ValueError(f"{where} holds what is no number: {fields[2:]}") from None

    if not is_length:
        raise ValueError(f"{where}: the length {printed} is none")
    if not all(0 <= at < size for at, size in zip(ends, (columns, rows) * 2, strict=True)):
        raise ValueError(f"{where}: start or goal {ends} lies off a map of {columns} x {rows}")

    return MovingAiScenario(
        map_name=fields[1],
        shape=(columns, rows),
        start=(ends[0], rows - 1 - ends[1]),
        goal=(ends[2], rows - 1 - ends[3]),
        printed=printed,
    )


def map_of(
    path: Path, scenarios: tuple[MovingAiScenario, ...], folder: Path | None = None
) -> MovingAiMap:
    """The map of a scenario file, which lies beside it, or anywhere below a folder.

    Raises
    ------
    FileNotFoundError
        Where it does not.
    ValueError
        Where a scenario is of a map of another name or size.
    """
    names = {each.map_name for each in scenarios}
    if len(names) != 1:
        raise ValueError(f"{path}: its scenarios are of {len(names)} maps: {sorted(names)[:3]}")

    # "arena.map.scen" is of "arena.map", whatever folder it names
    name = names.pop().replace("\\", "/").split("/")[-1]
    places = [path.with_suffix(""), path.parent / name]
    if folder is not None:
        places += sorted(each for each in folder.rglob("*.map") if each.name == name)

    place = next((each for each in places if each.suffix == ".map" and each.is_file()), None)
    if place is None:
        raise FileNotFoundError(f"{path}: there is no map {name!r} beside it")

    found = load_movingai(place)
    for n, each in enumerate(scenarios):
        if each.shape != found.shape:
            raise ValueError(
                f"{path}: scenario {n} is of a map of {each.shape} cells, "
                f"and {place.name} has {found.shape}"
            )

    return found


def _text(path: Path, most: int) -> str:
    try:
        return read_file(path, most).decode("latin-1")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _count(name: str, field: str, words: list[str]) -> int:
    if len(words) != 2 or words[0] != field or not words[1].isdecimal() or len(words[1]) > 9:
        raise ValueError(f"{name}: {' '.join(words)!r} must be {field!r} and a number of cells")
    return int(words[1])
