"""`RadioCard`: sliders of the target, the elements and the phase bits."""

from collections.abc import Callable
from typing import Any

import numpy as np
import panel as pn

from irs_gym.workbench.bench import Bench, Place, elements_range
from irs_gym.workbench.widgets import CARD, refusal, say, set_new, title


class RadioCard:
    """Sliders; below each is said why a value of it is refused.

    Parameters
    ----------
    bench
        Gives the bench as it is.
    put
        Takes what a slider makes of it.
    """

    def __init__(self, bench: Callable[[], Bench], put: Callable[[Bench], None]) -> None:
        self._is_told = False  # of values, so that sliders have nothing to tell
        width = CARD - 40
        self._target = pn.widgets.FloatSlider(
            label="Target (dB)", start=-90.0, end=-40.0, step=0.1, width=width - 96
        )
        self._exact_target = pn.widgets.FloatInput(label="exactly", step=0.1, width=76)
        self._elements = pn.widgets.IntSlider(label="Elements on each panel", end=1, width=width)
        self._bits = pn.widgets.DiscreteSlider(
            label="Phase bits",
            options={"1": 1, "2": 2, "3": 3, "4": 4, "continuous": None},
            value=None,
            width=width,
        )
        self._refusals: dict[Place, Any] = {
            place: refusal() for place in ("target_db", "irs_elements", "phase_bits")
        }

        def told(act: Callable[[Any], Bench]) -> Callable[[Any], None]:
            def hear(event: Any) -> None:
                if not self._is_told and event.new is not None:
                    put(act(event.new))

            return hear

        for field in (self._target, self._exact_target):
            field.param.watch(told(lambda db: bench().with_target(db)), "value")
        self._elements.param.watch(told(lambda count: bench().with_elements(count)), "value")
        self._bits.param.watch(lambda event: self._hear_bits(event, bench, put), "value")

        self.layout = pn.Column(
            title("Radio"),
            pn.Row(self._target, self._exact_target),
            self._refusals["target_db"],
            self._elements,
            self._refusals["irs_elements"],
            self._bits,
            self._refusals["phase_bits"],
        )

    def _hear_bits(
        self, event: Any, bench: Callable[[], Bench], put: Callable[[Bench], None]
    ) -> None:
        if not self._is_told:
            put(bench().with_phase_bits(event.new))  # None is continuous

    def fit(self, bench: Bench) -> None:
        """Give the sliders the ranges of another scene."""
        scene = bench.scene
        gain = bench.drawing.radio_map.gain_db
        reach = [*gain[np.isfinite(gain)].tolist(), scene.target_db]
        _, most, step = elements_range(scene)
        own = scene.phase_bits
        bits = {str(n): n for n in sorted({1, 2, 3, 4, *([own] if own else [])})}

        self._is_told = True
        self._target.param.update(start=float(np.floor(min(reach))), end=float(np.ceil(max(reach))))
        self._elements.param.update(end=max(most, 1), step=max(step, 1), disabled=most == 0)
        set_new(self._bits, options={**bits, "continuous": None})
        self._is_told = False

    def show(self, bench: Bench) -> None:
        """Tell the sliders what is so, and say what was refused."""
        now, _, _ = elements_range(bench.scene)
        self._is_told = True
        for field in (self._target, self._exact_target):
            set_new(field, value=bench.scene.target_db)
        set_new(self._elements, value=now if bench.is_irs_on else 0)
        set_new(self._bits, value=bench.scene.phase_bits)
        self._is_told = False

        for place, pane in self._refusals.items():
            say(pane, bench.why(place))
