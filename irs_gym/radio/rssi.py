"""`from_rssi_histograms`: a measured room, of a histogram of received power in each cell, as a
`RadioMap`.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.files import as_path, read_file
from irs_gym.grid import Grid, checked_cell_size, checked_point
from irs_gym.memory import check_memory
from irs_gym.radio.fading import MeasuredFading
from irs_gym.radio.radio_map import RadioMap
from irs_gym.units import Floats

_GRID_FILE = re.compile(r"(.+)_rssi_([^_]+)_(\d+(?:\.\d+)?)\.grd")
_NEAR = 1e-6  # in cells and in shares: what printed decimals may be off
_LARGEST = 1e6  # metres from a room's corner
_PARSED = 40  # bytes of memory for a byte of the text, at the most


def from_rssi_histograms(
    folder: str | Path, receiver: str, cell_size: float | None = None
) -> RadioMap:
    r"""Radio map of a folder in the format of the Position-Annotated BLE RSSI Dataset (github
    philotuxo/Position-Annotated-BLE-RSSI-Dataset).

    Its gains are received powers in dBm of one transmitter, no path gains: they fit targets in dBm
    alone. The transmitter moved and the receivers stood: a receiver stands for an access point by
    reciprocity. In the dataset's grids, the histograms between the places that were measured are
    its authors' Wasserstein interpolation.

    Parameters
    ----------
    folder
        Holds ``grd/*/NAME_rssi_RECEIVER_CELLSIZE.grd`` and ``occ/NAME_CELLSIZE.occ``.
    receiver
        Name of the receiver, as in the names of the files.
    cell_size
        Which of several resolutions, in metres; None where the folder has one.

    Returns
    -------
    RadioMap
        ``gain_db`` is the mean of the power, in dBm, and ``fading`` holds the histograms: what they
        lack of 1 was too weak for their lowest level. ``free`` are the cells of occupancy **0**;
        the dataset's own README says it the other way round. The coordinates of a cell are those of
        its centre.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder, or it holds no such files.
    ValueError
        Where there is no such receiver, with the names of those that there are; where a file is
        damaged or too large, or the grids of histograms and occupancy differ.

    Examples
    --------
    A room of two cells, one of them walkable:

    >>> area = "[[0.0, 0.0], [0.5, 0.0]]::0.5"
    >>> histograms = "[0.0, 0.0]::b::[0.5, 0.5]\n[0.5, 0.0]::b::[1, 0]\n"
    >>> files = {
    ...     "room/grd/mine/mine_rssi_a1_0.5.grd": f"a1::{area}::[-80, -70]\n{histograms}",
    ...     "room/occ/mine_0.5.occ": f"{area}\n[0.0, 0.0]::0\n[0.5, 0.0]::1\n",
    ... }
    >>> for name, text in files.items():
    ...     Path(name).parent.mkdir(parents=True, exist_ok=True)
    ...     _ = Path(name).write_text(text)
    >>> radio_map = from_rssi_histograms("room", receiver="a1")
    >>> radio_map.gain_db.round(2).tolist(), radio_map.fading.outage(-75.0).tolist()
    ([[-72.6], [-inf]], [[0.5], [1.0]])
    """
    place = as_path(folder, "folder")
    file = _chosen(_grid_files(place), receiver, cell_size, place)
    grid, fading = _read_histograms(file)
    free = _read_occupancy(place / "occ" / f"{file.data_set}_{file.cell_size}.occ", grid)

    return RadioMap(fading.mean_gain_db, grid=grid, free=free, fading=fading)


def rssi_receivers(folder: str | Path) -> tuple[str, ...]:
    """Names of the receivers of a folder, in order; `from_rssi_histograms` reads each.

    Raises ``FileNotFoundError`` where the folder holds none.
    """
    return tuple(sorted({file.receiver for file in _grid_files(as_path(folder, "folder"))}))


@dataclass(frozen=True)
class _GridFile:
    """A file of histograms, and what its name says."""

    path: Path
    data_set: str
    receiver: str
    cell_size: str


def _grid_files(folder: Path) -> list[_GridFile]:
    found = [(path, _GRID_FILE.fullmatch(path.name)) for path in sorted(folder.glob("grd/*/*.grd"))]
    files = [_GridFile(path, *match.groups()) for path, match in found if match]
    if not files:
        raise FileNotFoundError(
            f"{str(folder)!r} holds no files grd/*/NAME_rssi_RECEIVER_CELLSIZE.grd"
        )

    return files


def _chosen(files: list[_GridFile], receiver: Any, cell_size: Any, folder: Path) -> _GridFile:
    """The file of a receiver; a ``ValueError`` tells which there are."""
    own = [file for file in files if file.receiver == receiver]
    if not own:
        names = ", ".join(sorted({file.receiver for file in files}))
        raise ValueError(f"receiver={receiver!r} is not in {str(folder)!r}, which has {names}")

    wanted = None if cell_size is None else checked_cell_size(cell_size)
    chosen = [file for file in own if wanted in (None, float(file.cell_size))]
    if len(chosen) != 1:
        names = ", ".join(str(file.path.relative_to(folder)) for file in own)
        raise ValueError(f"cell_size={cell_size!r} must choose one of {names}")

    return chosen[0]


# --- lines ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Lines:
    """A file: the parts of its header, and of each line after it."""

    path: Path
    header: list[str]
    body: list[list[str]]

    @classmethod
    def read(cls, path: Path, header: int, body: int) -> "_Lines":
        """The file's lines, where each has as many parts as it must."""
        content = read_file(path)
        check_memory(f"{str(path)!r}: its numbers", float(len(content)) * _PARSED)
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"{str(path)!r} is no text") from None

        parts = [line.split("::") for line in text.splitlines() if line.strip()]
        if len(parts) < 2:
            raise ValueError(f"{str(path)!r} has no cells")

        for n, line in enumerate(parts):
            if len(line) != (body if n else header):
                raise ValueError(
                    f"{str(path)!r}: line {n + 1} has {len(line)} parts between '::', "
                    f"not {body if n else header}: the file is damaged or cut short"
                )

        return cls(path, parts[0], parts[1:])

    def numbers(self, text: str, what: str, count: int | None = None) -> Floats:
        """A row of finite numbers, as many as asked."""
        try:
            row = json.loads(text)
            numbers = np.array(row, dtype=np.float64) if _is_row(row) else None
        except (OverflowError, RecursionError, ValueError):  # no JSON: the line is cut off
            numbers = None

        if numbers is None or not np.isfinite(numbers).all():
            raise ValueError(
                f"{str(self.path)!r}: {what} {_short(text)} must be a row of finite numbers"
            )
        if count is not None and len(numbers) != count:
            raise ValueError(f"{str(self.path)!r}: {what} has {len(numbers)} numbers, not {count}")

        return numbers

    def grid(self, limits: str, cell_size: str) -> tuple[tuple[float, float], float]:
        """Lower corner of the room and cell size, as the header says them."""
        try:
            lower, _ = json.loads(limits)
            return checked_point(lower, "limits"), checked_cell_size(json.loads(cell_size))
        except (RecursionError, TypeError, ValueError) as error:
            raise ValueError(f"{str(self.path)!r}: its header tells no grid: {error}") from None

    def cells(self, lower: tuple[float, float], cell_size: float) -> NDArray[np.int64]:
        """The cell (i, j) of each line, ``(lines, 2)``, where they make a whole rectangle."""
        places = np.stack([self.numbers(line[0], "cell", 2) for line in self.body])  # (lines, 2)
        if (np.abs(places) > _LARGEST).any():
            raise ValueError(f"{str(self.path)!r}: a cell lies {np.abs(places).max()} m away")

        position = (places - lower) / cell_size
        nearest = np.rint(position)
        if not (np.abs(position - nearest) < _NEAR * np.maximum(1.0, np.abs(position))).all():
            worst = int(np.argmax(np.abs(position - nearest).max(axis=1)))
            raise ValueError(
                f"{str(self.path)!r}: the cell {places[worst].tolist()} lies on no grid of "
                f"{cell_size} m from {list(lower)}"
            )

        columns, rows = (int(each) + 1 for each in nearest.max(axis=0))
        if nearest.min() < 0 or columns * rows != len(places):
            raise ValueError(
                f"{str(self.path)!r}: {len(places)} cells do not fill a grid of {columns} x {rows}"
            )

        cells = nearest.astype(np.int64)
        if len(np.unique(cells @ [rows, 1])) != len(cells):
            raise ValueError(f"{str(self.path)!r} tells a cell twice")

        return cells


def _is_row(value: Any) -> bool:
    return isinstance(value, list) and all(type(each) in (int, float) for each in value)


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else f"{text[:40]}...")


def _grid_of(cells: NDArray[np.int64], lower: tuple[float, float], cell_size: float) -> Grid:
    """The grid of which each place is a cell's centre."""
    columns, rows = (cells.max(axis=0) + 1).tolist()
    return Grid((columns, rows), cell_size, (lower[0] - cell_size / 2, lower[1] - cell_size / 2))


# --- files ----------------------------------------------------------------------------------------


def _read_histograms(file: _GridFile) -> tuple[Grid, MeasuredFading]:
    path = file.path
    lines = _Lines.read(path, header=4, body=3)
    name, limits, size, bins = lines.header
    lower, cell_size = lines.grid(limits, size)
    if (name, cell_size) != (file.receiver, float(file.cell_size)):
        raise ValueError(
            f"{str(path)!r} tells of receiver {_short(name)} in cells of {cell_size} m, "
            "and is named otherwise"
        )

    levels_db = lines.numbers(bins, "its levels")
    cells = lines.cells(lower, cell_size)
    grid = _grid_of(cells, lower, cell_size)
    shares = np.zeros((*grid.shape, len(levels_db)))

    for (i, j), line in zip(cells, lines.body, strict=True):
        shares[i, j] = lines.numbers(line[2], f"the histogram of cell {line[0]}", len(levels_db))

    total = shares.sum(axis=2, keepdims=True)  # (X, Y, 1)
    if (total < 1 + _NEAR).all():
        shares /= np.maximum(total, 1.0)  # rounding alone

    try:
        return grid, MeasuredFading(levels_db, shares)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from None


def _read_occupancy(path: Path, grid: Grid) -> NDArray[np.bool_]:
    """The cells that can be walked, ``(X, Y)``: those of occupancy 0."""
    lines = _Lines.read(path, header=2, body=2)
    lower, cell_size = lines.grid(*lines.header)
    cells = lines.cells(lower, cell_size)
    own = _grid_of(cells, lower, cell_size)
    if own != grid:
        raise ValueError(
            f"{str(path)!r} has {own.shape} cells of {own.cell_size} m from {own.origin}, "
            f"the histograms {grid.shape} of {grid.cell_size} m from {grid.origin}"
        )

    values = [line[1].strip() for line in lines.body]
    wrong = [value for value in values if value not in ("0", "1")]
    if wrong:
        raise ValueError(f"{str(path)!r}: the occupancy {_short(wrong[0])} is neither 0 nor 1")

    free = np.zeros(grid.shape, dtype=bool)
    free[tuple(cells.T)] = [value == "0" for value in values]

    return free
