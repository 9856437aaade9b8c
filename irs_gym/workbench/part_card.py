"""`PartCard`: the numbers of the part that is held, to type in."""

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from irs_gym.workbench.bench import SNAP, Bench
from irs_gym.workbench.handle import numbers_of
from irs_gym.workbench.widgets import CARD, refusal, say, set_new, title

_FIELDS = 5  # numbers of a part, at the most
_HINT = "Drag a part on the floor, or click on it to type in where it is."


class PartCard:
    """Fields of the part that is held; below them is said why it cannot be so.

    Parameters
    ----------
    bench
        Gives the bench as it is.
    put
        Takes what a field or button makes of it.
    """

    def __init__(self, bench: Callable[[], Bench], put: Callable[[Bench], None]) -> None:
        self._is_told = False  # of values, so that fields have nothing to tell
        self._name = pn.pane.HTML(_HINT, width=CARD - 20, margin=(0, 10))
        self._fields = [pn.widgets.FloatInput(width=86, step=SNAP) for _ in range(_FIELDS)]
        self._twice = pn.widgets.Button(label="Duplicate", width=90)
        self._twice.on_click(lambda _: put(bench().duplicated()))
        self._less = pn.widgets.Button(label="Remove", width=90)
        self._less.on_click(lambda _: put(bench().removed()))
        self._refusal = refusal()

        def hear(n: int, event: Any) -> None:
            now = bench()
            if self._is_told or event.new is None or now.held is None:
                return
            put(now.edited(list(numbers_of(now.scene, now.held))[n], event.new))
            self.show(bench())  # what was refused goes back to what it was

        for n, field in enumerate(self._fields):
            field.param.watch(partial(hear, n), "value")

        self.layout = pn.Column(
            title("Part"),
            self._name,
            pn.Row(*self._fields[:3]),
            pn.Row(*self._fields[3:]),
            pn.Row(self._twice, self._less),
            self._refusal,
        )

    def show(self, bench: Bench) -> None:
        """Tell the fields what is so, and say what was refused."""
        held = bench.held
        numbers = list(numbers_of(bench.scene, held).items()) if held else []
        is_listed = held is not None and held.is_listed

        self._is_told = True
        for n, field in enumerate(self._fields):
            label, value = numbers[n] if n < len(numbers) else ("", None)
            set_new(field, label=f"{label} (m)", value=value, visible=value is not None)
        set_new(self._name, object=f"<code>{held}</code>" if held else _HINT)
        set_new(self._twice, visible=is_listed)
        set_new(self._less, visible=is_listed)
        self._is_told = False

        say(self._refusal, bench.why("part"))
