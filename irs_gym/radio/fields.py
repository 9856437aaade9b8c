"""Types of a scene file's fields: lengths, points, decibels and names, each within its bounds."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


def _not_tiny(value: float) -> float:
    if value < 1e-6:
        raise ValueError("Input should be greater than or equal to 1e-06")
    return value


# Beyond these bounds no formula here means anything, and numbers of 64 bits overflow or lose
# micrometres.
Metres = Annotated[float, Field(ge=-1e7, le=1e7)]
Length = Annotated[float, Field(gt=0, le=1e7)]
CellSize = Annotated[Length, AfterValidator(_not_tiny)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
Decibels = Annotated[float, Field(ge=-1000, le=1000)]
Frequency = Annotated[float, Field(gt=0, le=1e6), AfterValidator(_not_tiny)]  # GHz
Pitch = Annotated[float, Field(gt=0, le=1e6), AfterValidator(_not_tiny)]  # wavelengths
Count = Annotated[int, Field(ge=1, le=10**9)]
PhaseBits = Annotated[int, Field(ge=1, le=16)]
Point2 = tuple[Metres, Metres]
Point3 = tuple[Metres, Metres, Metres]
Wall = Literal["x_min", "x_max", "y_min", "y_max"]


class Part(BaseModel):
    """What every part of a scene is: frozen, of finite numbers, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
