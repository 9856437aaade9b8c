"""`outage_probability`: how often each cell's instantaneous channel gain lies below a threshold."""

from pathlib import Path

from irs_gym.radio.fading import checked_threshold
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import Scene
from irs_gym.units import Floats


def outage_probability(
    scene: Scene | str | Path,
    threshold_db: float,
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
) -> Floats:
    """Probability in each cell that the instantaneous channel gain abs(c)^2 lies below a threshold.

    The phase shifts are those of `irs_gym.build_radio_map`: they follow the expected gain, not the
    fading. The channel is then a fixed line-of-sight part and a scattered part of power tau (Lemma
    1), which is complex Gaussian but for the product of the two scattered channels of each panel.
    That is a sum over its M elements: what it lacks of a Gaussian falls as 1/M, or as 1/sqrt(M)
    where both links of the panel are clear, and counts for as much as the product does in tau.
    ``docs/fading.md`` tells from which M on it is too small to be seen. The formula is that of
    `irs_gym.radio.fading.RicianFading.outage`.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    threshold_db
        The threshold in dB.
    cell_size, irs_elements, phase_bits, quantiser, array_model
        See `irs_gym.build_radio_map`.

    Returns
    -------
    float64, shape ``(X, Y)``, from 0 to 1; 1 where nothing is received, as in obstacles. With
    several access points, each cell is served by the one of the highest expected gain.

    Raises
    ------
    FileNotFoundError
        Where there is no such scene.
    ValueError
        Where an argument is out of its range; the message names it.

    Examples
    --------
    >>> outage = outage_probability("paper", -70.0, cell_size=1.0)
    >>> outage.shape, float(outage.min()) > 0, float(outage.max())
    ((20, 20), True, 1.0)
    """
    threshold = checked_threshold(threshold_db, "threshold_db")
    radio_map = build_radio_map(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)

    return radio_map.fading.outage(threshold)  # type: ignore[union-attr]  # a scene tells it
