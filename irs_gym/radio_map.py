"""`RadioMap`: the expected channel gain of every floor cell, built from a scene, from an array or from a file."""

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.files import write_file
from irs_gym.geometry import is_in_footprint
from irs_gym.grid import Grid
from irs_gym.irs import ArrayModel, Hardware, Quantiser, channel
from irs_gym.scene import Scene, load_scene
from irs_gym.units import Floats, linear_to_db

_BLOCK = 2**20  # complex entries (cells x sub-surfaces or elements) in work at a time: bounds memory for any map
# What reading a file that is no map, or a damaged one, may raise.
DAMAGE = (ValueError, KeyError, EOFError, TypeError, OSError, NotImplementedError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, eq=False)
class RadioMap:
    """The paper's channel power gain map C over a grid.

    Attributes
    ----------
    gain_db
        float64, shape ``(X, Y)``, read-only: expected channel gain in dB of the cell ``[i, j]``; -inf where a robot
        cannot be (obstacles) or nothing is received.
    grid
        The cells.
    """

    gain_db: NDArray[np.float64]
    grid: Grid = field(kw_only=True)

    def __post_init__(self) -> None:
        gain = np.array(self.gain_db, dtype=np.float64)
        if gain.shape != self.grid.shape:
            raise ValueError(f"gain_db has the shape {gain.shape}, the grid {self.grid.shape}")
        if np.isnan(gain).any() or np.isposinf(gain).any():
            raise ValueError("gain_db holds NaN or +inf: each cell must be a number of dB, or -inf where blocked")
        gain.setflags(write=False)
        object.__setattr__(self, "gain_db", gain)

    @classmethod
    def from_array(cls, gain_db: ArrayLike, cell_size: float, origin: tuple[float, float] = (0.0, 0.0)) -> "RadioMap":
        """Radio map measured or computed elsewhere.

        Parameters
        ----------
        gain_db
            Shape ``(X, Y)`` in dB, ``[i, j]`` with i along x; -inf in obstacles.
        cell_size
            Edge of a cell in metres.
        origin
            Lower left corner of the floor in metres.

        Raises
        ------
        ValueError
            Where the array is not 2-D, real and free of NaN and +inf, or ``cell_size`` is not positive.
        """
        gain = np.asarray(gain_db)
        if gain.dtype.kind not in "iuf":
            raise ValueError(f"gain_db holds values of the type {gain.dtype}, not real numbers of dB")
        if gain.ndim != 2 or not gain.size:
            raise ValueError(f"gain_db has the shape {gain.shape}, but a map has two axes (X, Y)")
        return cls(gain, grid=Grid((gain.shape[0], gain.shape[1]), cell_size, (*origin,)))

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> "RadioMap":
        """Map of what `to_data` gives; a ``ValueError`` says what is wrong with it."""
        if set(data) != {"gain_db", "cell_size", "origin"}:
            raise ValueError(f"radio_map holds {sorted(map(str, data))}, not gain_db, cell_size and origin")
        try:
            gain_db = [[-np.inf if gain is None else gain for gain in row] for row in data["gain_db"]]
            return cls.from_array(gain_db, data["cell_size"], (*data["origin"],))
        except (TypeError, ValueError) as error:
            raise ValueError(f"radio_map: {error}") from None

    def to_data(self) -> dict[str, Any]:
        """The map as JSON can hold it: lists ``gain_db``, with None for -inf, and ``origin``; ``cell_size``."""
        return {
            "gain_db": [[gain if isfinite(gain) else None for gain in row] for row in self.gain_db.tolist()],
            "cell_size": float(self.grid.cell_size),
            "origin": [float(metres) for metres in self.grid.origin],
        }

    @property
    def free(self) -> NDArray[np.bool_]:
        """Cells that a robot can enter, whatever the target: shape ``(X, Y)``."""
        return np.isfinite(self.gain_db)

    def feasible(self, target_db: float) -> NDArray[np.bool_]:
        """The feasible map Pi of eq. (16): cells at or above the target, shape ``(X, Y)``."""
        if np.isnan(target_db):
            raise ValueError("target_db is NaN: it must be a number of dB")
        return self.free & (self.gain_db >= target_db)

    def save(self, path: str | Path) -> None:
        """Write the map as an ``.npz`` file, atomically."""
        content = BytesIO()
        np.savez_compressed(
            content,
            format_version=np.int64(1),
            gain_db=self.gain_db,
            cell_size=np.float64(self.grid.cell_size),
            origin=np.array(self.grid.origin),
        )
        write_file(Path(path), content.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> "RadioMap":
        """Map written by `save`; never unpickles.

        Raises
        ------
        ValueError
            Where the file is not such a map, or damaged.
        """
        with open(path, "rb") as stream:
            try:
                if not zipfile.is_zipfile(stream):
                    raise ValueError("it is not a whole npz archive")
                stream.seek(0)
                return cls._read(stream)
            except DAMAGE as error:
                raise ValueError(f"{str(path)!r} is not a radio map: {error}") from None

    @classmethod
    def _read(cls, stream: BinaryIO) -> "RadioMap":
        with np.load(stream, allow_pickle=False) as file:
            if int(file["format_version"]) != 1:
                raise ValueError(f"its format_version is {int(file['format_version'])}, and 1 is read here")
            return cls.from_array(file["gain_db"], float(file["cell_size"]), file["origin"].tolist())


def build_radio_map(
    scene: Scene | str | Path = "paper",
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> RadioMap:
    """The exact expected channel gain of every cell (eq. 15, with the corrections of Lemma 1).

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    cell_size
        Edge of a cell in metres; must divide both sides of the room.
    irs_elements
        Elements on each panel, the paper's M; 0 is its "without IRS". None: as the scene says (1,200 in ``"paper"``).
    phase_bits, quantiser, array_model
        See `irs_gym.irs.Hardware`. ``phase_bits=None``: as the scene says (continuous phases in ``"paper"``).

    Returns
    -------
    RadioMap
        With ``gain_db`` of shape ``(X, Y)``, -inf in cells whose centre lies strictly inside an obstacle. With
        several access points, each cell is served by the one that gives it the highest gain.

    Raises
    ------
    FileNotFoundError
        Where there is no such scene.
    ValueError
        Where an argument is out of its range; the message names it.
    """
    scene = as_scene(scene).with_irs_elements(irs_elements)
    hardware, grid = _hardware(scene, phase_bits, quantiser, array_model), scene.grid(cell_size)
    gain_db = np.full(grid.shape, -np.inf)
    for cells, positions in _blocks(scene, grid, hardware):
        gains = [channel(scene, ap, positions).expected_gain(hardware) for ap in scene.access_points]
        gain_db.flat[cells] = linear_to_db(np.max(gains, axis=0))
    return RadioMap(gain_db, grid=grid)


def build_phase_shifts(
    scene: Scene | str | Path = "paper",
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> NDArray[np.float32]:
    """The phase shift that each sub-surface holds while the robot is in a cell, in [0, 2 pi).

    Same arguments as `build_radio_map`. Shape ``(X, Y, N)`` with N the sub-surfaces of all panels, panel after
    panel, column after column; zero in obstacles. With several access points, the phases serve the cell's own.
    """
    scene = as_scene(scene).with_irs_elements(irs_elements)
    hardware, grid = _hardware(scene, phase_bits, quantiser, array_model), scene.grid(cell_size)
    shifts = np.zeros((*grid.shape, sum(panel.subsurfaces for panel in scene.irs_panels)), dtype=np.float32)
    by_cell = shifts.reshape(grid.shape[0] * grid.shape[1], -1)
    for cells, positions in _blocks(scene, grid, hardware):
        channels = [channel(scene, ap, positions) for ap in scene.access_points]
        serving = np.argmax([each.expected_gain(hardware) for each in channels], axis=0)
        for n, each in enumerate(channels):
            by_cell[cells[serving == n]] = each.phase_shifts(hardware)[serving == n]
    return shifts


def as_scene(scene: Scene | str | Path) -> Scene:
    """The scene itself, or the one of that name or path."""
    return scene if isinstance(scene, Scene) else load_scene(scene)


def _hardware(scene: Scene, phase_bits: int | None, quantiser: Quantiser, array_model: ArrayModel) -> Hardware:
    return Hardware(scene.phase_bits if phase_bits is None else phase_bits, quantiser, array_model)


def _blocks(scene: Scene, grid: Grid, hardware: Hardware) -> Iterator[tuple[NDArray[np.int64], Floats]]:
    """Free cells as flat indices ``(n,)`` and antenna positions ``(n, 3)``, block by block."""
    floor = grid.centres().reshape(-1, 2)
    free = np.flatnonzero(~is_in_footprint(floor, scene.boxes))
    is_spherical = hardware.array_model == "spherical"
    width = max([p.elements if is_spherical else p.subsurfaces for p in scene.irs_panels], default=1)
    needs_array = is_spherical or hardware.levels is not None
    block = max(1, min(2**15, _BLOCK // width)) if needs_array else 2**15
    for first in range(0, len(free), block):
        cells = free[first : first + block]
        height = np.full((len(cells), 1), scene.antenna_height)
        yield cells, np.concatenate([floor[cells], height], axis=1)
