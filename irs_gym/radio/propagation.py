"""`Link`: path loss, line of sight and Rician moments of the links from many points to one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.radio.path_loss import MultiWall, PathLoss, PresetName, formulas_of
from irs_gym.radio.scene import Scene
from irs_gym.units import Floats, db_to_linear


def path_loss_db(
    distance_m: ArrayLike,
    is_clear: NDArray[np.bool_],
    path_loss: PathLoss | PresetName | MultiWall,
    carrier_ghz: float,
) -> Floats:
    """Path loss in dB, eqs. (18) and (19) of the paper (3GPP TR 38.901, InF-SH in its scene).

    Without line of sight it is never less than with it. The loss of walls that are counted comes on
    top.

    Parameters
    ----------
    distance_m
        3-D distance, any shape.
    is_clear
        Line of sight or not, same shape.
    path_loss
        Coefficients, or a model by name.
    """
    with_sight, without_sight = formulas_of(path_loss)
    los = with_sight.loss_db(distance_m, carrier_ghz)

    # the paper's max(L_LoS, L_NLoS) without line of sight; of some presets, that of three
    nlos = los
    for formula in without_sight:
        nlos = np.maximum(nlos, formula.loss_db(distance_m, carrier_ghz))

    return np.asarray(np.where(is_clear, los, nlos))


@dataclass(frozen=True)
class Link:
    """The moments of Rician links, each array of the same shape.

    With path gain L (linear) and Rician factor K (0 without line of sight), the channel has the
    deterministic amplitude ``los_amplitude`` = sqrt(eta K) and scattered entries of mean power
    ``scattered_power`` = eta, where eta = L / (K + 1) (Lemma 1).
    """

    distance_m: Floats
    direction: Floats  # (..., 3), unit vectors from the common end to each point
    path_gain: Floats
    rician_factor: Floats

    @property
    def scattered_power(self) -> Floats:
        """Eta of Lemma 1."""
        return self.path_gain / (self.rician_factor + 1.0)

    @property
    def los_amplitude(self) -> Floats:
        """sqrt(eta K) of Lemma 1."""
        return np.sqrt(self.scattered_power * self.rician_factor)


def link(scene: Scene, points: NDArray[np.float64], end: ArrayLike) -> Link:
    """Links between ``points`` ``(..., 3)`` and one common ``end`` ``(3,)``, in metres.

    Raises
    ------
    ValueError
        Where a point coincides with the end, as the path loss model knows no distance of 0, or is
        so near to it that path loss would be a gain.
    """
    offset = points - np.asarray(end, dtype=np.float64)  # (..., 3)
    distance = np.sqrt(np.einsum("...k,...k->...", offset, offset))
    if not distance.all():
        raise ValueError(
            f"an antenna at {tuple(np.asarray(end).tolist())} m coincides with the centre of a cell"
        )

    if isinstance(scene.path_loss, MultiWall):
        walls = scene.floor.walls_crossed(points, end)
        is_clear = np.asarray(walls == 0)
        through_walls_db = scene.path_loss.wall_loss_db * walls
    else:
        is_clear = scene.floor.is_line_of_sight(points, end)
        through_walls_db = np.zeros(())

    loss_db = path_loss_db(distance, is_clear, scene.path_loss, scene.carrier_ghz)
    loss_db = loss_db + through_walls_db
    if not np.all(loss_db >= 0):
        nearest = float(distance.flat[np.argmin(loss_db)])
        raise ValueError(
            f"path_loss is {loss_db.min():.4g} dB at {nearest:.3g} m from an antenna at "
            f"{tuple(np.asarray(end).tolist())} m, and no passive link has one below 0"
        )

    gain = db_to_linear(-loss_db)  # L of eqs. (1) to (3): the loss in dB, as a linear gain
    rician = np.where(is_clear, db_to_linear(scene.rician_factor_db), 0.0)

    return Link(distance, offset / distance[..., None], gain, rician)
