"""`Codebook`: the configurations that a scene's panels hold, how they are made, and their gains."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.files import as_path, read_arrays, write_file
from irs_gym.grid import Cell, as_cell
from irs_gym.memory import check_memory, freeze
from irs_gym.radio.irs import ArrayModel, Quantiser, channel
from irs_gym.radio.radio_map import (
    BLOCK,
    ENTRY_BYTES,
    LINK_BYTES,
    RadioModel,
    cell_blocks,
    check_gains,
    entries_of_a_cell,
    serve,
)
from irs_gym.radio.scene import IrsPanel, Scene
from irs_gym.units import Floats, linear_to_db, wavelength_m

_HASH = re.compile(r"[0-9a-f]{64}")
_LARGEST_SIZE = 10**9  # configurations
_LONGEST_DESIGN = 200  # characters
# What a scene tells that no gain depends on.
_NOT_RADIO = {"name", "start", "goal", "target_db", "phase_bits", "format_version"}


@dataclass(frozen=True, eq=False)
class Codebook:
    """The stored configurations of a scene's panels, which hold one of them at a time.

    `from_array` makes one of any phase shifts; `focused_codebook`, `dft_codebook` and
    `irs_gym.cover_codebook` design one.

    Attributes
    ----------
    phase_shifts
        float64, shape ``(K, N)``, read-only: K configurations of the N sub-surfaces of all panels
        in radians, panel after panel, column after column.
    radio_hash
        SHA-256 of the scene and panels that it is for, see `radio_hash`.
    design
        How it was made, in words.

    Raises
    ------
    ValueError
        Where the phase shifts are no finite numbers of that shape, or there is none.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> codebook = Codebook.from_array(np.zeros((2, 60)), load_scene("paper"))
    >>> codebook.size, codebook.phase_shifts.shape
    (2, (2, 60))
    """

    phase_shifts: NDArray[np.float64]
    radio_hash: str
    design: str = "given"

    def __post_init__(self) -> None:
        object.__setattr__(self, "phase_shifts", _checked_shifts(self.phase_shifts))
        freeze(self.phase_shifts)

        if not isinstance(self.radio_hash, str) or not _HASH.fullmatch(self.radio_hash):
            raise ValueError(f"radio_hash={self.radio_hash!r} must be 64 hexadecimal digits")
        if not isinstance(self.design, str) or len(self.design) > _LONGEST_DESIGN:
            raise ValueError(f"design must be a string of at most {_LONGEST_DESIGN} characters")

    @classmethod
    def from_array(
        cls,
        phase_shifts: ArrayLike,
        scene: Scene | str | Path = "paper",
        irs_elements: int | None = None,
    ) -> "Codebook":
        """Codebook of phase shifts ``(K, N)`` in radians that were designed or measured elsewhere.

        Raises
        ------
        ValueError
            Where they are no such numbers, or N is not what the scene's panels have.
        """
        built = _built(_model(scene, irs_elements=irs_elements))
        codebook = cls(phase_shifts, radio_hash(built))  # type: ignore[arg-type]  # made an array
        codebook.check_scene(built)

        return codebook

    @property
    def size(self) -> int:
        """K, the number of configurations."""
        return len(self.phase_shifts)

    def check_scene(self, scene: Scene) -> None:
        """Refuse a scene, with the elements that its panels are built of, that the codebook is not
        for: a ``ValueError`` says why.
        """
        subsurfaces = sum(panel.subsurfaces for panel in scene.irs_panels)
        if self.phase_shifts.shape[1] != subsurfaces:
            raise ValueError(
                f"codebook: it holds phase shifts of {self.phase_shifts.shape[1]} sub-surfaces, "
                f"but the panels of scene {scene.name!r} have {subsurfaces}"
            )
        if self.radio_hash != radio_hash(scene):
            raise ValueError(
                f"codebook: it was made for another scene or panel than those of {scene.name!r}"
            )

    def save(self, path: str | Path) -> None:
        """Write the codebook as an ``.npz`` file, atomically."""
        content = BytesIO()
        np.savez_compressed(
            content,
            format_version=np.int64(1),
            phase_shifts=self.phase_shifts,
            radio_hash=np.array(self.radio_hash),
            design=np.array(self.design),
        )
        write_file(as_path(path, "codebook"), content.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> "Codebook":
        """Codebook written by `save`; never unpickles.

        Raises
        ------
        FileNotFoundError
            Where there is no such file.
        ValueError
            Where the file is not such a codebook, or damaged; where it or its arrays are larger
            than the memory limit.
        """
        place = as_path(path, "codebook")

        try:
            arrays = read_arrays(
                place, needed=("format_version", "phase_shifts", "radio_hash", "design")
            )
            version = _scalar(arrays, "format_version", "iu")
            if version != 1:
                raise ValueError(f"its format_version is {version}, and 1 is read here")

            return cls(
                arrays["phase_shifts"],
                _scalar(arrays, "radio_hash", "U"),
                _scalar(arrays, "design", "U"),
            )
        except ValueError as error:
            raise ValueError(f"{str(place)!r} is not a codebook: {error}") from None

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> "Codebook":
        """Codebook of what `to_data` gives; a ``ValueError`` says what is wrong with it."""
        if set(data) != {"phase_shifts", "radio_hash", "design"}:
            raise ValueError(
                f"codebook holds {sorted(map(str, data))}, not phase_shifts, radio_hash and design"
            )
        return cls(**data)

    def to_data(self) -> dict[str, Any]:
        """The codebook as JSON can hold it."""
        return {
            "phase_shifts": self.phase_shifts.tolist(),
            "radio_hash": self.radio_hash,
            "design": self.design,
        }


def radio_hash(scene: Scene) -> str:
    """SHA-256 of all that a gain depends on in a scene whose panels are built: not of its name, its
    start and goal, its target and the resolution of its phase shifters.

    What a scene leaves at its default does not count, so that hashes outlive new fields.
    """
    data = scene.model_dump(mode="json", exclude=_NOT_RADIO, exclude_defaults=True)
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


# --- designs --------------------------------------------------------------------------------------


def focused_codebook(
    scene: Scene | str | Path,
    cells: ArrayLike,
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> Codebook:
    """The best configuration of each of some cells: eq. (14) of the paper, for that cell alone.

    These are the phase shifts that `irs_gym.build_radio_map` assumes in those cells. Where the
    access point is blocked, the reference phase is 0; with several, a configuration serves the one
    that is best in its cell.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    cells
        Cells (i, j), shape ``(K, 2)``, none of them inside an obstacle.
    cell_size, irs_elements, phase_bits, quantiser, array_model
        As for `irs_gym.build_radio_map`.

    Raises
    ------
    ValueError
        Where an argument is out of its range, a cell is none that a robot can enter, there is none,
        or the scene has no panel; the message names it.

    Examples
    --------
    >>> focused_codebook("paper", [(0, 20), (39, 20)]).phase_shifts.shape
    (2, 60)
    """
    model = _model(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    built = _built(model)
    hardware = model.hardware
    positions = _antennas(model, cells)  # (K, 3)

    width = entries_of_a_cell(model, needs_shifts=True)
    subsurfaces = sum(panel.subsurfaces for panel in built.irs_panels)
    _check_memory(model, len(positions), len(positions) * subsurfaces, width)
    shifts = np.zeros((len(positions), subsurfaces))  # (K, N)
    block = max(1, BLOCK // width)

    for first in range(0, len(positions), block):
        some = slice(first, first + block)
        shifts[some] = serve(built, hardware, positions[some], needs_shifts=True)[2]

    return Codebook(shifts, radio_hash(built), f"focused on {len(positions)} cells")


def dft_codebook(
    scene: Scene | str | Path,
    size: int,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
) -> Codebook:
    """Beams: the steering vectors of each panel, phase shifts that grow by one step from column to
    column and by another from row to row.

    The columns and rows of a discrete Fourier transform, for ``size`` = A x B steps along the wall
    and up: B is the largest divisor of the size that is at most its square root and the panel's
    rows. Steps are evenly spaced over all that plane waves can have on the panel: the whole circle
    where sub-surfaces are a quarter of a wavelength apart or more, and 2 k times their distance to
    both sides where they are closer. A step of 0, the mirror's, is among them. With several panels,
    each holds its beam of the same number.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    size
        K, the number of configurations.
    irs_elements, phase_bits, quantiser
        As for `irs_gym.build_radio_map`; beams have no channel to be ``"optimal"`` for, so that
        their phase shifts are those of the ``"nearest"`` level too.

    Raises
    ------
    ValueError
        Where an argument is out of its range, or the scene has no panel; the message names it.

    Examples
    --------
    >>> beams = dft_codebook("paper", 8)
    >>> beams.phase_shifts.shape
    (8, 60)
    >>> beams.phase_shifts[5].any().item()  # of 4 x 2, the sixth is the mirror
    False
    """
    model = _model(scene, 1.0, irs_elements, phase_bits, quantiser)
    built = _built(model)
    size = checked_size(size)
    subsurfaces = sum(panel.subsurfaces for panel in built.irs_panels)
    check_memory(
        f"size={size}: configurations of {subsurfaces} sub-surfaces", 24.0 * size * subsurfaces
    )
    beams = [_beams(built, panel, size) for panel in built.irs_panels]
    shifts = np.mod(np.concatenate(beams, axis=1), 2 * np.pi)  # (K, N)

    levels = model.hardware.levels
    if levels is not None:
        delta = 2 * np.pi / levels
        level = np.rint(shifts / delta)  # from 0 to L, and level L is level 0 but as printed
        level = np.minimum(level, levels - 1) if quantiser == "as_printed" else level % levels
        shifts = level * delta

    return Codebook(shifts, radio_hash(built), f"{size} beams")


def _beams(scene: Scene, panel: IrsPanel, size: int) -> Floats:
    """Phase shifts of a panel's beams, ``(size, C * R)``, unwrapped."""
    most_up = min(panel.rows, isqrt(size))
    up = next(n for n in range(most_up, 0, -1) if size % n == 0)
    pitch_m = panel.pitch_wavelengths * wavelength_m(scene.carrier_ghz)
    per_column, per_row = panel.elements_per_subsurface

    along_steps = _steps(size // up, per_column * pitch_m / wavelength_m(scene.carrier_ghz))
    up_steps = _steps(up, per_row * pitch_m / wavelength_m(scene.carrier_ghz))
    columns = np.multiply.outer(along_steps, np.arange(panel.columns))  # (A, C)
    rows = np.multiply.outer(up_steps, np.arange(panel.rows))  # (B, R)
    beams = columns[:, None, :, None] + rows[None, :, None, :]  # (A, B, C, R)

    return np.asarray(beams.reshape(size, -1))


def _steps(count: int, apart: float) -> Floats:
    """Evenly spaced phase steps between sub-surfaces ``apart`` wavelengths apart, 0 among them."""
    # k apart (u + u') for unit vectors u, u': at most 2 k apart; beyond half a turn steps repeat
    widest = min(np.pi, 2 * 2 * np.pi * apart)
    return np.asarray((np.arange(count) - count // 2) * (2 * widest / count))


# --- gains ----------------------------------------------------------------------------------------


def codebook_gain_db(
    scene: Scene | str | Path,
    codebook: Codebook,
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    array_model: ArrayModel = "far_field",
) -> NDArray[np.float64]:
    """The expected channel gain of every cell under each configuration: Lemma 1, as corrected by
    Appendix A, for phase shifts that are given.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    codebook
        Configurations of this scene's panels.
    cell_size
        Edge of a cell in metres; must divide both sides of the room.
    irs_elements, array_model
        As for `irs_gym.build_radio_map`.

    Returns
    -------
    In dB, shape ``(K, X, Y)``, -inf in cells whose centre lies strictly inside an obstacle. With
    several access points, each cell is served by the one that gives it the highest gain under that
    configuration.

    Raises
    ------
    ValueError
        Where the codebook is for another scene or panel, an argument out of its range, or the work
        larger than memory; the message names it.

    Examples
    --------
    >>> from irs_gym import build_radio_map
    >>> gain_db = codebook_gain_db("paper", focused_codebook("paper", [(4, 20)]))
    >>> gain_db.shape
    (1, 40, 40)
    >>> bool(abs(gain_db[0, 4, 20] - build_radio_map("paper").gain_db[4, 20]) < 1e-9)
    True
    """
    if not isinstance(codebook, Codebook):
        raise ValueError(f"codebook={codebook!r} must be a Codebook")

    model = _model(scene, cell_size, irs_elements, array_model=array_model)
    built = _built(model)
    codebook.check_scene(built)
    grid = model.grid
    cells_in_all = grid.shape[0] * grid.shape[1]

    width = max(entries_of_a_cell(model, needs_shifts=True), codebook.size)
    _check_memory(model, cells_in_all, cells_in_all * codebook.size, width)
    turns = np.exp(1j * codebook.phase_shifts.T)  # (N, K)
    gain_db = np.full((codebook.size, cells_in_all), -np.inf)

    for cells, positions in cell_blocks(built, grid, width):
        gains = np.zeros((len(cells), codebook.size))  # (n, K), linear

        for access_point in built.access_points:
            site = channel(built, access_point, positions)
            total = site.direct_los[:, None] + site.reflected_los(array_model) @ turns  # (n, K)
            own = np.abs(total) ** 2 + site.scattered_power()[:, None]
            gains = np.maximum(gains, own)

        check_gains(grid, cells, gains.min(axis=1))
        gain_db[:, cells] = linear_to_db(gains.T)

    return gain_db.reshape(codebook.size, *grid.shape)


# --- arguments ------------------------------------------------------------------------------------


def _model(
    scene: Scene | str | Path,
    cell_size: float = 1.0,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> RadioModel:
    model = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    _ = model.hardware  # refused now where it is none
    return model


def _built(model: RadioModel) -> Scene:
    """The scene with its panels; a ``ValueError`` where it has none to configure."""
    built = model.built_scene
    if not built.irs_panels:
        raise ValueError(
            f"codebook: scene {built.name!r} has no IRS panel to configure "
            f"(irs_elements={model.irs_elements})"
        )

    return built


def _antennas(model: RadioModel, cells: ArrayLike) -> Floats:
    """Antenna positions ``(K, 3)`` of robots in the cells; a ``ValueError`` where one is none that
    a robot can enter.
    """
    grid = model.grid
    places = [as_cell(cell, f"cells[{n}]") for n, cell in enumerate(_listed(cells))]
    if not places:
        raise ValueError("cells holds none: a codebook has one configuration or more")

    off = next((n for n, cell in enumerate(places) if not grid.has(cell)), None)
    if off is not None:
        raise ValueError(f"cells[{off}]={places[off]} lies off the map of {grid.shape} cells")

    floor = np.array([grid.centre(cell) for cell in places])  # (K, 2)
    inside = np.flatnonzero(model.built_scene.floor.is_covered(floor))
    if len(inside):
        raise ValueError(f"cells[{inside[0]}]={places[inside[0]]} lies inside an obstacle")

    return np.column_stack([floor, np.full(len(floor), model.built_scene.antenna_height)])


def _listed(cells: Any) -> list[Cell]:
    is_array = isinstance(cells, np.ndarray)
    if is_array and (cells.shape[1:] != (2,) or len(cells) > _LARGEST_SIZE):
        raise ValueError(
            f"cells has the shape {cells.shape}: it must be (K, 2), K at most {_LARGEST_SIZE}"
        )

    try:
        return list(np.asarray(cells).tolist() if isinstance(cells, np.ndarray) else cells)
    except TypeError:
        raise ValueError(f"cells={cells!r} must be a list of cells (i, j)") from None


def checked_size(size: Any) -> int:
    """A number of configurations; a ``ValueError`` where it is none from 1 on."""
    is_number = isinstance(size, int | np.integer) and not isinstance(size, bool)
    if not is_number or not 1 <= size <= _LARGEST_SIZE:
        raise ValueError(
            f"size={size!r} must be a positive number of configurations, at most {_LARGEST_SIZE}"
        )
    return int(size)


def _checked_shifts(phase_shifts: Any) -> NDArray[np.float64]:
    try:
        shifts = np.array(phase_shifts)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"phase_shifts is no array: {error}") from None

    if shifts.dtype.kind not in "iuf":
        raise ValueError(f"phase_shifts holds values of the type {shifts.dtype}, not real numbers")
    if shifts.ndim != 2 or not shifts.size:
        raise ValueError(
            f"phase_shifts has the shape {shifts.shape}, but a codebook has one configuration or "
            "more of one sub-surface or more (K, N)"
        )

    shifts = shifts.astype(np.float64, copy=False)
    if not np.isfinite(shifts).all():
        raise ValueError("phase_shifts holds NaN or inf: each must be a number of radians")

    return shifts


def _check_memory(model: RadioModel, cells: int, results: int, width: int) -> None:
    """Refuse work on so many cells, at so many complex entries for each, before any."""
    scene = model.built_scene
    panels = len(scene.irs_panels)
    check_memory(
        f"codebook: {results:,} numbers of {cells:,} cells, at cell_size={model.cell_size},",
        8.0 * results + min(max(BLOCK, width), cells * width) * (panels + 1) * ENTRY_BYTES,
        8.0 * results + float(cells) * width * panels * len(scene.access_points) * ENTRY_BYTES,
    )
    links = len(scene.access_points) * (1 + panels)
    check_memory(
        f"codebook: {links} links past {len(scene.obstacles)} obstacles to each of {cells:,} cells",
        0,
        float(cells) * links * (1 + scene.floor.tests) * LINK_BYTES,
    )


def _scalar(arrays: dict[str, NDArray[Any]], name: str, kinds: str) -> Any:
    if arrays[name].shape != () or arrays[name].dtype.kind not in kinds:
        raise ValueError(f"{name} must be a single value, not {arrays[name].tolist()!r}")
    return arrays[name].item()
