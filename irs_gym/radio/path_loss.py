"""Path loss of a scene: coefficients of one's own, presets by name, and walls that are counted."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from irs_gym.radio.fields import Decibels, Part
from irs_gym.units import SPEED_OF_LIGHT


class PathLossCoefficients(Part):
    """Path loss = intercept + distance_slope log10(d / m) + frequency_slope log10(f / GHz), in dB.

    The form of eqs. (18) and (19) of the paper, and of 3GPP TR 38.901, table 7.4.1-1.
    """

    intercept_db: Decibels
    distance_slope_db: Decibels
    frequency_slope_db: Decibels

    def loss_db(self, distance_m: Any, carrier_ghz: float) -> Any:
        """Path loss in dB over distances in metres, of any shape."""
        return (
            self.intercept_db
            + self.distance_slope_db * np.log10(distance_m)
            + self.frequency_slope_db * np.log10(carrier_ghz)
        )


class PathLoss(Part):
    """Coefficients with and without line of sight (3GPP TR 38.901, table 7.4.1-1, InF-SH in the
    paper).
    """

    line_of_sight: PathLossCoefficients
    non_line_of_sight: PathLossCoefficients


class MultiWall(Part):
    """Free space, and so many dB for each wall in the way: the multi-wall model of the COST 231
    final report, chapter 4.7, with one kind of wall, on one floor, and no constant loss.

    L = L_FS + k_w L_w. The report has L_w = 3.4 dB for light walls (plasterboard, or full of
    windows) and 6.9 dB for heavy ones (brick, concrete), at 1.8 GHz. Every obstacle of the scene
    counts as a wall, as often as the straight line passes through it.
    """

    wall_loss_db: Annotated[float, Field(ge=0, le=1000)]


PresetName = Literal["InF-SL", "InF-DL", "InF-SH", "InF-DH", "InH-Office", "free-space"]


def _formula(intercept: float, distance: float, frequency: float) -> PathLossCoefficients:
    return PathLossCoefficients(
        intercept_db=intercept, distance_slope_db=distance, frequency_slope_db=frequency
    )


# (4 pi d f / c)^2 for d = 1 m and f = 1 GHz, in dB: 32.45
FREE_SPACE = _formula(20 * np.log10(4 * np.pi * 1e9 / SPEED_OF_LIGHT), 20.0, 20.0)
_FACTORY = _formula(31.84, 21.50, 19.00)
_SPARSE_LOW = _formula(33.0, 25.5, 20.0)

# 3GPP TR 38.901, table 7.4.1-1: the formula with line of sight, and those whose greatest holds
# without. There d is the 3D distance, up to 600 m in a factory and 150 m in an office.
PRESETS: dict[PresetName, tuple[PathLossCoefficients, tuple[PathLossCoefficients, ...]]] = {
    "InF-SL": (_FACTORY, (_SPARSE_LOW,)),
    "InF-DL": (_FACTORY, (_formula(18.6, 35.7, 20.0), _SPARSE_LOW)),
    "InF-SH": (_FACTORY, (_formula(32.4, 23.0, 20.0),)),
    "InF-DH": (_FACTORY, (_formula(33.63, 21.9, 20.0),)),
    "InH-Office": (_formula(32.4, 17.3, 20.0), (_formula(17.30, 38.3, 24.9),)),
    "free-space": (FREE_SPACE, ()),
}


def _kind(value: Any) -> str:
    """Which of the models of path loss a value is meant to be."""
    if isinstance(value, str):
        return "<preset>"
    is_multi_wall = isinstance(value, MultiWall) or (
        isinstance(value, dict) and "wall_loss_db" in value
    )
    return "<multi-wall>" if is_multi_wall else "<coefficients>"


PathLossModel = Annotated[
    Annotated[PathLoss, Tag("<coefficients>")]
    | Annotated[PresetName, Tag("<preset>")]
    | Annotated[MultiWall, Tag("<multi-wall>")],
    Discriminator(_kind),
]


def formulas_of(
    model: PathLoss | PresetName | MultiWall,
) -> tuple[PathLossCoefficients, tuple[PathLossCoefficients, ...]]:
    """The formula with line of sight, and those whose greatest holds without, walls not counted.

    Examples
    --------
    >>> formulas_of("InF-SH")[0].loss_db(10.0, carrier_ghz=1.0).round(2)
    np.float64(53.34)
    """
    if isinstance(model, PathLoss):
        return model.line_of_sight, (model.non_line_of_sight,)
    return PRESETS["free-space" if isinstance(model, MultiWall) else model]
