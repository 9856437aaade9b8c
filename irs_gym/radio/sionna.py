"""`from_sionna`: a radio map traced by Sionna RT, as a `RadioMap`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.radio.radio_map import RadioMap
from irs_gym.units import linear_to_db

_DECIMALS = 6  # Sionna holds metres in single precision: below a micrometre there is only rounding


def from_sionna(radio_map: Any, free: NDArray[np.bool_] | None = None) -> RadioMap:
    """Radio map of what Sionna RT's ``RadioMapSolver`` returns for a horizontal measurement plane.

    Each cell is served by the transmitter of the highest path gain. Sionna's path gain is the mean
    of abs(c)^2 over the cell, for antennas as the scene sets them: the expected channel gain of
    this package, for isotropic ones.

    Parameters
    ----------
    radio_map
        A ``sionna.rt.PlanarRadioMap`` (sionna-rt 2.x), or anything with its ``path_gain``
        (transmitters, Y, X), ``cell_centers`` (Y, X, 3) and ``cell_size`` (2,).
    free
        Bool, shape ``(X, Y)``: the cells that a robot can enter. Rays reach into some materials, so
        the map alone does not say. A free cell that no ray reaches stays free, with a gain of -inf.
        None: all cells that receive anything.

    Returns
    -------
    RadioMap
        With ``gain_db`` of shape ``(X, Y)``, -inf where not free or where no path arrives.

    Raises
    ------
    TypeError
        Where the result is no planar radio map (a mesh radio map has no cells of one size).
    ValueError
        Where the plane is not horizontal and aligned with the axes, its cells are not square, or an
        array is at fault.

    Examples
    --------
    What stands in for Sionna's result here is made by hand:

    >>> from types import SimpleNamespace
    >>> centres = [[[0.25, 0.25, 1.5], [0.75, 0.25, 1.5]]]  # two cells along x
    >>> path_gain = [[[1e-6, 0.0]]]
    >>> traced = SimpleNamespace(path_gain=path_gain, cell_centers=centres, cell_size=(0.5, 0.5))
    >>> radio_map = from_sionna(traced)
    >>> radio_map.gain_db.tolist(), radio_map.grid.origin
    ([[-60.0], [-inf]], (0.0, 0.0))
    """
    missing = [
        name for name in ("path_gain", "cell_centers", "cell_size") if not hasattr(radio_map, name)
    ]
    if missing:
        raise TypeError(
            f"{type(radio_map).__name__} has no {', '.join(missing)}: a planar radio map is needed"
        )

    path_gain = np.asarray(radio_map.path_gain, dtype=np.float64)
    if path_gain.ndim != 3 or not path_gain.size or not np.all(path_gain >= 0):
        raise ValueError(
            f"path_gain, of the shape {path_gain.shape}, must be linear gains (transmitters, Y, X)"
        )

    # the best transmitter of each cell; Sionna's rows run along y, ours along x
    gain_db = linear_to_db(path_gain.max(axis=0).T)  # (X, Y)
    if free is not None and (np.shape(free) != gain_db.shape or np.asarray(free).dtype != bool):
        raise ValueError(f"free must be an array of bools of the map's shape {gain_db.shape}")

    cell_size, origin = _cells(radio_map, gain_db.shape)

    return RadioMap.from_array(gain_db, cell_size, origin, free)


def _cells(radio_map: Any, shape: tuple[int, ...]) -> tuple[float, tuple[float, float]]:
    """Cell size and lower left corner in metres, of a plane that must lie as a `irs_gym.grid.Grid`
    does.
    """
    sizes = np.asarray(radio_map.cell_size, dtype=np.float64).ravel().round(_DECIMALS)
    if sizes.shape != (2,) or sizes[0] != sizes[1]:
        raise ValueError(f"cell_size={sizes.tolist()} must be one size in metres along x and y")

    cell_size = float(sizes[0])
    centres = np.asarray(radio_map.cell_centers, dtype=np.float64)
    if centres.shape != (shape[1], shape[0], 3):
        raise ValueError(
            f"cell_centers has the shape {centres.shape}, "
            f"but the path gains need {(*shape[::-1], 3)}"
        )

    # where all centres would be, counted from the first one
    first = centres[0, 0]
    x, y = (low + cell_size * np.arange(n) for low, n in zip(first[:2], shape, strict=True))
    level = np.stack([*np.meshgrid(x, y), np.full(shape[::-1], first[2])], axis=-1)
    if not np.allclose(centres, level, rtol=0, atol=cell_size / 100):
        raise ValueError(
            "the measurement plane must be horizontal, its cells along x and y: "
            "orientation=(0, 0, 0)"
        )

    corner_x, corner_y = (first[:2] - cell_size / 2).round(_DECIMALS).tolist()

    return cell_size, (corner_x, corner_y)
