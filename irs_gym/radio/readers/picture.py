"""`read_picture`: the floor plan that a black-and-white picture shows; `shades_of`: a picture's
shades.
"""

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from irs_gym.files import as_path, read_file
from irs_gym.grid import checked_cell_size
from irs_gym.radio.readers.floor_plan import CEILING, FloorPlan, check_cells, plan_of_cells
from irs_gym.radio.shapes import MOST_RASTER_CELLS

FORMATS = ("PNG", "PPM", "JPEG", "BMP", "GIF", "TIFF")
_FILE_BYTES = 2**28


def read_picture(
    path: str | Path,
    metres_per_pixel: float,
    threshold: float = 0.5,
    height: float = CEILING,
    origin: tuple[float, float] = (0.0, 0.0),
) -> FloorPlan:
    """Floor plan of a picture on which walls are dark.

    Parameters
    ----------
    path
        Of a PNG, PGM, JPEG, BMP, GIF or TIFF file.
    metres_per_pixel
        Edge of a pixel in metres.
    threshold
        Pixels darker than this are blocked: 0 is black, 1 is white.
    height
        Of the ceiling and of all that is blocked, in metres.
    origin
        Of the picture's lower left corner, in metres.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    ValueError
        Where it is no such picture, damaged or too large, or an argument is out of its range; the
        message names file or argument.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "hall.png"
    ...     Image.fromarray(np.array([[0, 255, 255], [255, 255, 0]], dtype=np.uint8)).save(file)
    ...     read_picture(file, metres_per_pixel=0.1).data["obstacles"][0]["rows"]
    ['#..', '..#']
    """
    place = as_path(path, "path")
    try:
        scale = checked_cell_size(metres_per_pixel)
    except ValueError as error:
        raise ValueError(str(error).replace("cell_size", "metres_per_pixel")) from None
    if isinstance(threshold, bool) or not 0 < threshold <= 1:
        raise ValueError(f"threshold={threshold!r} must be a shade above 0, up to 1 for white")

    is_blocked = shades_of(place, on_white=True) < threshold

    return plan_of_cells(place.stem, is_blocked, scale, origin, height)


def shades_of(path: Path, *, on_white: bool) -> NDArray[np.float64]:
    """Mean of a picture's channels from 0 (black) to 1 (white), shape ``(X, Y)``, ``[i, j]`` with i
    to the right and j upwards.

    Where pixels have an opacity, the picture lies on white; otherwise opacity is one of the
    channels, as map_server of ROS counts it. Raises as `read_picture`.
    """
    content = read_file(path, _FILE_BYTES)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # asked for below
            picture = Image.open(BytesIO(content), formats=FORMATS)

        check_cells(str(path), *picture.size)
        channels = _channels(picture)  # (Y, X, C), from the top
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path}: more than {MOST_RASTER_CELLS} pixels: {error}") from None
    except (OSError, SyntaxError, EOFError, OverflowError) as error:
        raise ValueError(f"{path}: no picture that can be read: {error}") from None
    except ValueError as error:  # of a number in the file, or of its size, which names the file
        said = str(error)
        raise ValueError(said if said.startswith(str(path)) else f"{path}: {said}") from None

    if on_white and channels.shape[2] % 2 == 0:  # shades and opacity
        opacity = channels[..., -1:]
        channels = channels[..., :-1] * opacity + (1 - opacity)

    return np.ascontiguousarray(channels.mean(axis=2)[::-1].T)


def _channels(picture: Image.Image) -> NDArray[np.float64]:
    """Channels of the pixels from 0 to 1, ``(Y, X, C)``: one shade or three colours, and an opacity
    behind them where there is any.
    """
    if picture.mode.startswith("I"):  # 16 bits
        return np.asarray(picture, dtype=np.float64)[..., None] / 65535

    has_opacity = picture.mode in ("LA", "PA", "RGBA") or "transparency" in picture.info
    is_grey = picture.mode in ("1", "L", "LA")
    mode = ("LA" if has_opacity else "L") if is_grey else ("RGBA" if has_opacity else "RGB")
    values = np.asarray(picture.convert(mode), dtype=np.float64) / 255

    return values[..., None] if values.ndim == 2 else values
