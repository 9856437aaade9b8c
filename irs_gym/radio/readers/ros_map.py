"""`read_ros_map`: the floor plan that a map of ROS's map_server is, a picture and its settings."""

from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from irs_gym.files import as_path, read_file
from irs_gym.radio.fields import Length, Metres
from irs_gym.radio.readers.floor_plan import CEILING, FloorPlan, plan_of_cells
from irs_gym.radio.readers.picture import shades_of
from irs_gym.radio.scene import in_one_line

_FILE_BYTES = 2**16
Share = Annotated[float, Field(ge=0, le=1)]


def _not_turned(yaw: Any) -> Any:
    if yaw != 0:
        raise ValueError("a turned map cannot be read: the yaw of origin must be 0")
    return yaw


class _Settings(BaseModel):
    """What is used of ``map.yaml``; other keys are ignored, as map_server does."""

    model_config = ConfigDict(allow_inf_nan=False)

    image: Annotated[str, Field(min_length=1)]
    resolution: Length  # metres, of a pixel
    origin: tuple[Metres, Metres, Annotated[float, BeforeValidator(_not_turned)]]
    negate: Annotated[int, Field(ge=0, le=1)]
    occupied_thresh: Share
    free_thresh: Share
    mode: Literal["trinary"] = "trinary"


def read_ros_map(
    path: str | Path, height: float = CEILING, *, unknown_is_free: bool = False
) -> FloorPlan:
    r"""Floor plan of a map of map_server: ``map.yaml``, and the PGM or PNG file that it names.

    A pixel's occupancy is 1 where it is black and 0 where it is white, or the other way round with
    ``negate``. Above ``occupied_thresh`` it is blocked, below ``free_thresh`` free, and between
    them unknown (mode ``trinary``).

    Parameters
    ----------
    path
        Of the yaml file.
    height
        Of the ceiling and of all that is blocked, in metres.
    unknown_is_free
        Whether robots may go where the map knows nothing; by default that is blocked as well.

    Raises
    ------
    FileNotFoundError
        Where there is no such file or picture.
    ValueError
        Where one is damaged or too large, or the map is turned or of another mode; the message
        names file and field.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> said = "image: map.pgm\nresolution: 0.05\norigin: [-1.0, 0.0, 0.0]\nnegate: 0\n"
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "map.yaml"
    ...     _ = file.write_text(said + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    ...     shades = bytes([0, 254, 205, 0, 254, 205])
    ...     _ = file.with_name("map.pgm").write_bytes(b"P5 3 2 255\n" + shades)
    ...     read_ros_map(file).data["obstacles"][0]["rows"]
    ['#.#', '#.#']
    """
    place = as_path(path, "path")
    settings = _settings(place)
    if settings.free_thresh > settings.occupied_thresh:
        raise ValueError(
            f"{place}: free_thresh={settings.free_thresh} is above "
            f"occupied_thresh={settings.occupied_thresh}"
        )

    image = place.parent / as_path(settings.image, f"{place}: image")
    if not image.is_file():
        raise FileNotFoundError(f"{place}: image={settings.image!r} is no file beside it")

    shade = shades_of(image, on_white=False)  # (X, Y)
    occupancy = shade if settings.negate else 1 - shade
    is_blocked = (
        occupancy > settings.occupied_thresh
        if unknown_is_free
        else occupancy >= settings.free_thresh
    )

    return plan_of_cells(place.stem, is_blocked, settings.resolution, settings.origin[:2], height)


def _settings(path: Path) -> _Settings:
    """What the yaml file says; a ``ValueError`` names file and field."""
    try:
        data = yaml.safe_load(read_file(path, _FILE_BYTES).decode())
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ValueError(f"{path}: it is no yaml file: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path}: it holds no settings of a map, such as resolution: 0.05")

    # what has no place here is not even shown: a few bytes of yaml can stand for many
    known = {key: value for key, value in data.items() if key in _Settings.model_fields}
    for key, value in known.items():
        parts = value if isinstance(value, list) else [value]
        if len(parts) > 3 or any(isinstance(part, list | dict | set) for part in parts):
            raise ValueError(f"{path}: {key} must be a number, a word or three numbers")

    try:
        return _Settings.model_validate(known)
    except ValidationError as error:
        raise ValueError(f"{path}: {in_one_line(error)}") from None
