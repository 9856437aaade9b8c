"""`RadioMap`: the expected channel gain of every floor cell, built of a `RadioModel`, an array or a
file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.files import as_path, read_arrays, write_file
from irs_gym.grid import Grid, checked_map
from irs_gym.memory import check_memory, freeze
from irs_gym.radio.fading import Fading, MeasuredFading, RicianFading, fading_of
from irs_gym.radio.irs import ArrayModel, Hardware, Quantiser, channel
from irs_gym.radio.scene import Scene, load_scene
from irs_gym.radio.solids import centres_of, overlooked, solids_of
from irs_gym.units import Floats, linear_to_db

# complex entries (cells x sub-surfaces or elements) in work at a time: bounds memory for any map
BLOCK = 2**20
ENTRY_BYTES = 160  # for each of them, at the most
_CELL_BYTES = 64  # for each cell of a map that is built
LINK_BYTES = 400  # gone over for each cell and box in the way, for each link


@dataclass(frozen=True, eq=False)
class RadioMap:
    """The paper's channel power gain map C over a grid.

    Attributes
    ----------
    gain_db
        float64, shape ``(X, Y)``, read-only: expected channel gain in dB of the cell ``[i, j]``;
        -inf where a robot cannot be (obstacles) or nothing is received.
    grid
        The cells.
    free
        Bool, shape ``(X, Y)``, read-only: the cells that a robot can enter, whatever the target. By
        default those where anything is received.
    fading
        How the instantaneous gain of each cell is distributed; None where nothing tells.

    Examples
    --------
    >>> import numpy as np
    >>> radio_map = RadioMap.from_array([[-60.0, -np.inf, -70.0]], cell_size=0.5)
    >>> radio_map.feasible(-65.0).tolist(), radio_map.free.tolist()
    ([[True, False, False]], [[True, False, True]])
    """

    gain_db: NDArray[np.float64]
    grid: Grid = field(kw_only=True)
    free: NDArray[np.bool_] = field(kw_only=True, default=None)  # type: ignore[arg-type]  # set below
    fading: Fading | None = field(kw_only=True, default=None)

    def __post_init__(self) -> None:
        gain = np.array(checked_map(self.gain_db, "gain_db", "iuf", _CELL_BYTES))
        if gain.shape != self.grid.shape:
            raise ValueError(f"gain_db has the shape {gain.shape}, the grid {self.grid.shape}")

        free = np.isfinite(gain)
        if self.free is not None:
            free = np.array(checked_map(self.free, "free", "b"))
            if free.shape != gain.shape:
                raise ValueError(f"free has the shape {free.shape}, gain_db {gain.shape}")
            gain[~free] = -np.inf

        if self.fading is not None and self.fading.shape != gain.shape:
            raise ValueError(f"fading has the shape {self.fading.shape}, gain_db {gain.shape}")

        freeze(gain, free)
        object.__setattr__(self, "gain_db", gain)
        object.__setattr__(self, "free", free)

    @classmethod
    def from_array(
        cls,
        gain_db: ArrayLike,
        cell_size: float,
        origin: tuple[float, float] = (0.0, 0.0),
        free: ArrayLike | None = None,
        fading: Fading | None = None,
    ) -> "RadioMap":
        """Radio map measured or computed elsewhere.

        Parameters
        ----------
        gain_db
            Shape ``(X, Y)`` in dB, ``[i, j]`` with i along x; -inf in obstacles.
        cell_size
            Edge of a cell in metres.
        origin
            Lower left corner of the floor in metres.
        free
            Bool, shape ``(X, Y)``: the cells that a robot can enter, where some of them receive
            nothing.
        fading
            A `irs_gym.radio.fading.RicianFading` or `irs_gym.radio.fading.MeasuredFading`, for
            `irs_gym.cost_map`.

        Raises
        ------
        ValueError
            Where the array is not 2-D, real and free of NaN and +inf, or ``cell_size`` is not
            positive.
        """
        gain = checked_map(gain_db, "gain_db", "iuf", _CELL_BYTES)
        grid = Grid((gain.shape[0], gain.shape[1]), cell_size, origin)
        return cls(gain, grid=grid, free=free, fading=fading)  # type: ignore[arg-type]  # made an array

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> "RadioMap":
        """Map of what `to_data` gives; a ``ValueError`` says what is wrong with it."""
        if set(data) - {"free", "fading"} != {"gain_db", "cell_size", "origin"}:
            raise ValueError(
                f"radio_map holds {sorted(map(str, data))}, not gain_db, cell_size and origin"
            )

        try:
            gain_db = [
                [-np.inf if gain is None else gain for gain in row] for row in data["gain_db"]
            ]
            return cls.from_array(
                gain_db,
                data["cell_size"],
                (*data["origin"],),
                data.get("free"),
                fading_of(data.get("fading", {})),
            )
        except (TypeError, ValueError) as error:
            raise ValueError(f"radio_map: {error}") from None

    def to_data(self, fading: bool | None = None) -> dict[str, Any]:
        """The map as JSON can hold it: lists ``gain_db``, with None for -inf, and ``origin``;
        ``cell_size``.

        ``free`` is among it where a free cell receives nothing, and a dict ``fading`` where it is
        known and asked for; by default, where it was measured, so that no scene tells it again.
        """
        data: dict[str, Any] = {
            "gain_db": [
                [gain if isfinite(gain) else None for gain in row] for row in self.gain_db.tolist()
            ],
            "cell_size": float(self.grid.cell_size),
            "origin": [float(metres) for metres in self.grid.origin],
        }
        if not np.array_equal(self.free, np.isfinite(self.gain_db)):
            data["free"] = self.free.tolist()
        kept = self._kept_fading(fading)
        if kept:
            data["fading"] = {name: each.tolist() for name, each in kept.items()}

        return data

    def feasible(self, target_db: float) -> NDArray[np.bool_]:
        """The feasible map Pi of eq. (16): cells at or above the target, shape ``(X, Y)``."""
        if np.isnan(target_db):
            raise ValueError("target_db is NaN: it must be a number of dB")
        return self.free & (self.gain_db >= target_db)

    def save(self, path: str | Path, fading: bool | None = None) -> None:
        """Write the map as an ``.npz`` file, atomically; for ``fading`` see `to_data`."""
        arrays: dict[str, Any] = {
            "format_version": np.int64(1),
            "gain_db": self.gain_db,
            "cell_size": np.float64(self.grid.cell_size),
            "origin": np.array(self.grid.origin),
        }
        if not np.array_equal(self.free, np.isfinite(self.gain_db)):
            arrays["free"] = self.free
        arrays |= self._kept_fading(fading)

        content = BytesIO()
        np.savez_compressed(content, **arrays)
        write_file(Path(path), content.getvalue())

    def _kept_fading(self, asked: bool | None) -> dict[str, Floats]:
        """Arrays of the fading where they are asked for, by default where they were measured."""
        is_kept = isinstance(self.fading, MeasuredFading) if asked is None else asked
        return dict(vars(self.fading)) if is_kept and self.fading is not None else {}

    @classmethod
    def load(cls, path: str | Path) -> "RadioMap":
        """Map written by `save`; never unpickles.

        Raises
        ------
        FileNotFoundError
            Where there is no such file.
        ValueError
            Where the file is not such a map, or damaged; where it or its map is larger than the
            memory limit.
        """
        place = as_path(path, "radio_map")

        try:
            arrays = read_arrays(place, needed=("format_version", "gain_db", "cell_size", "origin"))
            version = _scalar(arrays, "format_version")
            if version != 1:
                raise ValueError(f"its format_version is {version}, and 1 is read here")

            return cls.from_array(
                arrays["gain_db"],
                _scalar(arrays, "cell_size"),
                arrays["origin"].tolist(),
                arrays.get("free"),
                fading_of(arrays),
            )
        except ValueError as error:
            raise ValueError(f"{str(place)!r} is not a radio map: {error}") from None


@dataclass(frozen=True, kw_only=True)
class RadioModel:
    """What the radio is: a scene in cells, and how its IRS is built and modelled.

    Attributes
    ----------
    scene
        The room with its obstacles, access points and panels.
    cell_size
        Edge of a cell in metres; must divide both sides of the room.
    irs_elements
        Elements on each panel in place of the scene's; None: as the scene says.
    phase_bits, quantiser, array_model
        See `irs_gym.radio.irs.Hardware`; ``phase_bits=None`` is continuous phases.

    Examples
    --------
    >>> RadioModel.of("paper", 1.0, None, None, "nearest", "far_field").grid.shape
    (20, 20)
    """

    scene: Scene
    cell_size: float
    irs_elements: int | None
    phase_bits: int | None
    quantiser: Quantiser
    array_model: ArrayModel

    @classmethod
    def of(
        cls,
        scene: Scene | str | Path,
        cell_size: float,
        irs_elements: int | None,
        phase_bits: int | None,
        quantiser: Quantiser,
        array_model: ArrayModel,
    ) -> "RadioModel":
        """Model of a scene, its name or its path, with the resolution that the scene says where
        none is given.
        """
        scene = as_scene(scene)
        return cls(
            scene=scene,
            cell_size=cell_size,
            irs_elements=irs_elements,
            phase_bits=scene.phase_bits if phase_bits is None else phase_bits,
            quantiser=quantiser,
            array_model=array_model,
        )

    @cached_property
    def built_scene(self) -> Scene:
        """The scene with `irs_elements` on its panels; a ``ValueError`` where they do not fit."""
        return self.scene.with_irs_elements(self.irs_elements)

    @property
    def hardware(self) -> Hardware:
        """The phase shifters, and how the array is modelled."""
        return Hardware(self.phase_bits, self.quantiser, self.array_model)

    @property
    def grid(self) -> Grid:
        """The cells; a ``ValueError`` where their size does not divide the room."""
        return self.scene.grid(self.cell_size)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Cells whose centre no obstacle covers, ``(X, Y)``."""
        grid = self.grid
        is_covered = self.scene.floor.is_covered(grid.centres().reshape(-1, 2))  # (X * Y,)
        return ~is_covered.reshape(grid.shape)


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
        Elements on each panel, the paper's M; 0 is its "without IRS". None: as the scene says
        (1,200 in ``"paper"``).
    phase_bits, quantiser, array_model
        See `irs_gym.radio.irs.Hardware`. ``phase_bits=None``: as the scene says (continuous phases
        in ``"paper"``).

    Returns
    -------
    RadioMap
        With ``gain_db`` of shape ``(X, Y)``, -inf in cells whose centre lies strictly inside an
        obstacle, or outside a room that is a polygon. With several access points, each cell is
        served by the one that gives it the highest gain.

    Warns
    -----
    UserWarning
        Where an obstacle holds the centre of no cell: it is named, and see `irs_gym.Robot`.

    Raises
    ------
    FileNotFoundError
        Where there is no such scene.
    ValueError
        Where an argument is out of its range; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> with_irs = build_radio_map("paper", cell_size=1.0)
    >>> without_irs = build_radio_map("paper", cell_size=1.0, irs_elements=0)
    >>> bool(np.all(with_irs.gain_db >= without_irs.gain_db))
    True
    """
    model = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    radio_map, _ = build_map_and_shifts(model, needs_shifts=False)

    _, blocking = solids_of(model.scene).met_by(centres_of(model.grid), 0.0)
    missed = overlooked(model.scene, blocking)
    if missed:
        warn(f'{missed}: robots drive through, unless with collision="body"', stacklevel=2)

    return radio_map


def build_phase_shifts(
    scene: Scene | str | Path = "paper",
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> NDArray[np.float32]:
    """The phase shift that each sub-surface holds while the robot is in a cell, in [0, 2 pi).

    Same arguments as `build_radio_map`. Shape ``(X, Y, N)`` with N the sub-surfaces of all panels,
    panel after panel, column after column; zero in obstacles. With several access points, the
    phases serve the cell's own.

    Examples
    --------
    >>> build_phase_shifts("paper", cell_size=1.0, phase_bits=1).shape  # 60 sub-surfaces
    (20, 20, 60)
    """
    model = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    _check_work(model, needs_shifts=True)
    shifts = _no_shifts(model, needs_shifts=True)
    by_cell = shifts.reshape(shifts.shape[0] * shifts.shape[1], -1)  # (X * Y, N), a view

    for cells, _, _, held in _receive(model, needs_shifts=True):
        by_cell[cells] = held

    return shifts


def build_map_and_shifts(
    model: RadioModel, *, needs_shifts: bool = True
) -> tuple[RadioMap, NDArray[np.float32]]:
    """What `build_radio_map` and `build_phase_shifts` give, in one pass over the channel.

    The shifts are of shape ``(X, Y, 0)`` where none are needed.
    """
    _check_work(model, needs_shifts=needs_shifts)
    grid = model.grid
    gain_db = np.full(grid.shape, -np.inf)
    los_gain = np.zeros(grid.shape)
    scattered_gain = np.zeros(grid.shape)
    shifts = _no_shifts(model, needs_shifts=needs_shifts)
    by_cell = shifts.reshape(gain_db.size, -1)  # (X * Y, N), a view

    for cells, gains, scattered, held in _receive(model, needs_shifts=needs_shifts):
        check_gains(grid, cells, gains)
        gain_db.flat[cells] = linear_to_db(gains)
        los_gain.flat[cells] = np.maximum(gains - scattered, 0.0)
        scattered_gain.flat[cells] = scattered
        by_cell[cells] = held

    return RadioMap(gain_db, grid=grid, fading=RicianFading(los_gain, scattered_gain)), shifts


def as_scene(scene: Scene | str | Path) -> Scene:
    """The scene itself, or the one of that name or path."""
    return scene if isinstance(scene, Scene) else load_scene(scene)


def _scalar(arrays: dict[str, NDArray[Any]], name: str) -> Any:
    if arrays[name].shape != () or arrays[name].dtype.kind not in "iuf":
        raise ValueError(f"{name}={arrays[name].tolist()!r} must be a scalar, one number")
    return arrays[name].item()


def _receive(
    model: RadioModel, *, needs_shifts: bool
) -> Iterator[tuple[NDArray[np.int64], Floats, Floats, Floats]]:
    """What is received in the free cells, block by block, each from the access point that serves it
    best.

    Yields flat indices of cells ``(n,)``, expected gains ``(n,)``, linear, their scattered parts
    tau ``(n,)``, and phase shifts ``(n, N)``, or ``(n, 0)`` where none are needed.
    """
    scene = model.built_scene
    hardware = model.hardware

    for cells, positions in cell_blocks(
        scene, model.grid, entries_of_a_cell(model, needs_shifts=needs_shifts)
    ):
        yield cells, *serve(scene, hardware, positions, needs_shifts=needs_shifts)


def serve(
    scene: Scene, hardware: Hardware, positions: Floats, *, needs_shifts: bool
) -> tuple[Floats, Floats, Floats]:
    """What is received at positions ``(n, 3)`` from the access point that serves each best.

    Returns expected gains ``(n,)`` and their scattered parts ``(n,)``, both linear, and phase
    shifts ``(n, N)``, or ``(n, 0)`` where none are needed.
    """
    gains = np.full(len(positions), -np.inf)  # (n,)
    scattered = np.zeros(len(positions))  # (n,)
    shifts = np.zeros((len(positions), 0))  # (n, N) from the first access point on

    for n, access_point in enumerate(scene.access_points):
        site = channel(scene, access_point, positions)
        if needs_shifts:
            own_gains, own_shifts = site.gain_and_shifts(hardware)
        else:
            own_gains, own_shifts = site.expected_gain(hardware), shifts

        # Of equal access points the first serves. The best so far is kept, not the shifts of all to
        # choose from: a block of shifts is large.
        is_better = own_gains > gains
        shifts = own_shifts if n == 0 else np.where(is_better[:, None], own_shifts, shifts)
        scattered = np.where(is_better, site.scattered_power(), scattered)
        gains = np.maximum(gains, own_gains)

    return gains, scattered, shifts


def _no_shifts(model: RadioModel, *, needs_shifts: bool) -> NDArray[np.float32]:
    """Phase shifts of 0 in every cell, ``(X, Y, N)``, or ``(X, Y, 0)`` where none are needed."""
    panels = model.built_scene.irs_panels if needs_shifts else ()
    subsurfaces = sum(panel.subsurfaces for panel in panels)

    return np.zeros((*model.grid.shape, subsurfaces), dtype=np.float32)


def entries_of_a_cell(model: RadioModel, *, needs_shifts: bool) -> int:
    """Complex entries for each cell: elements or sub-surfaces of the largest panel, 0 where sums
    need no array.
    """
    is_spherical = model.array_model == "spherical"
    if not (is_spherical or needs_shifts or model.hardware.levels is not None):
        return 0

    return max(
        [p.elements if is_spherical else p.subsurfaces for p in model.built_scene.irs_panels],
        default=0,
    )


def _check_work(model: RadioModel, *, needs_shifts: bool) -> None:
    """Refuse a map that would take too much memory or work, before any; the ``ValueError`` names
    what makes it large.
    """
    scene = model.built_scene
    width = entries_of_a_cell(model, needs_shifts=needs_shifts)
    grid = model.grid
    cells = grid.shape[0] * grid.shape[1]
    if needs_shifts:
        subsurfaces = sum(panel.subsurfaces for panel in scene.irs_panels)
        check_memory(
            f"irs_elements: phase shifts of {subsurfaces} sub-surfaces in {cells} cells, "
            f"at cell_size={model.cell_size},",
            4.0 * subsurfaces * cells,
        )

    block = max(BLOCK, width)
    grid.check_memory(_CELL_BYTES)
    links = len(scene.access_points) * (1 + len(scene.irs_panels))
    entries = len(scene.access_points) * max(1, len(scene.irs_panels)) * width
    check_memory(
        f"irs_elements: {width} elements or sub-surfaces for each of {cells} cells, "
        f"at cell_size={grid.cell_size},",
        min(block, cells * width) * max(1, len(scene.irs_panels)) * ENTRY_BYTES,
        cells * entries * ENTRY_BYTES,
    )
    check_memory(
        f"cell_size={grid.cell_size}: {links} links past {len(scene.obstacles)} obstacles "
        f"to each of {cells} cells",
        0,
        cells * links * (1 + scene.floor.tests) * LINK_BYTES,
    )


def check_gains(grid: Grid, cells: NDArray[np.int64], gains: Floats) -> None:
    """Refuse gains that are no positive numbers: they would pass for obstacles."""
    wrong = np.flatnonzero(~((gains > 0) & (gains < np.inf)))
    if len(wrong):
        cell = grid.cell_at(int(cells[wrong[0]]))
        what = "underflows to 0" if gains[wrong[0]] == 0 else f"is {gains[wrong[0]]}"
        raise ValueError(
            f"the expected gain in the free cell {cell} {what}: path_loss, carrier_ghz, "
            "rician_factor_db or the size of room and panels are beyond what numbers of 64 bits "
            "can hold"
        )


def cell_blocks(scene: Scene, grid: Grid, width: int) -> Iterator[tuple[NDArray[np.int64], Floats]]:
    """Free cells as flat indices ``(n,)`` and antenna positions ``(n, 3)``, block by block."""
    floor = grid.centres().reshape(-1, 2)
    free = np.flatnonzero(~scene.floor.is_covered(floor))
    block = max(1, min(2**15, BLOCK // width)) if width else 2**15

    for first in range(0, len(free), block):
        cells = free[first : first + block]
        height = np.full((len(cells), 1), scene.antenna_height)
        yield cells, np.concatenate([floor[cells], height], axis=1)
