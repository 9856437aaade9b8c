"""What the page says, as text and HTML."""

import logging
from collections.abc import Mapping
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irs_gym.oracle.shortest_path import path_length
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.commands import training_commands
from irs_gym.workbench.drawing import Drawing

_LOG = logging.getLogger(__name__)


def reason_of(error: BaseException) -> str:
    """Why something failed, in one line; what nobody foresaw goes to the log as well."""
    if isinstance(error, FileNotFoundError):
        return "the file is not there any more"
    if isinstance(error, OSError):
        return error.strerror or str(error)
    if isinstance(error, ValueError):
        return str(error)

    _LOG.error("a policy failed", exc_info=error)
    return f"{type(error).__name__}: {error}"


def summary_of(drawing: Drawing) -> str:
    """The line above the floor: shortest path, highest feasible target, share of feasible cells."""
    path = drawing.path
    highest = drawing.highest_target_db
    share = drawing.feasible.sum() / max(1, drawing.radio_map.free.sum())

    shortest = f"{path.distance:.3f} m" if path else f"none at {drawing.scene.target_db:.2f} dB"
    best = f"{highest:.3f} dB" if np.isfinite(highest) else "none"
    missed = f"<br>{_red(drawing.missed)}" if drawing.missed else ""

    return (
        f"shortest path <b>{shortest if path else _red(shortest)}</b> &ensp; "
        f"highest feasible target <b>{best}</b> &ensp; "
        f"feasible cells <b>{100 * share:.1f} %</b>{missed}"
    )


def score_of(bench: Bench, cells: NDArray[np.int64]) -> str:
    """How the cells ``(D, 2)`` of a policy's path compare with the oracle's."""
    drawing = bench.drawing
    distance = path_length(cells, drawing.radio_map.grid.cell_size)
    if tuple(cells[-1].tolist()) != drawing.goal:
        return f"does not reach the goal, after {distance:.3f} m"
    if drawing.path is None or drawing.path.distance == 0:
        return f"{distance:.3f} m"

    return f"{distance:.3f} m, {100 * (distance / drawing.path.distance - 1):+.1f} %"


def scores_of(bench: Bench, scores: Mapping[str, str], colours: Mapping[str, str]) -> str:
    """The oracle and the policies that were asked, each with the colour of its path."""
    path = bench.drawing.path
    oracle = f"{path.distance:.3f} m" if path else "no path"
    rows = [("oracle", oracle, "black"), *((n, text, colours[n]) for n, text in scores.items())]

    return "<br>".join(
        f"<span style='color:{colour}'>&#9473;&#9473;</span> {escape(name)}: {escape(text)}"
        for name, text, colour in rows
    )


def commands_of(file: Path, is_saved: bool) -> str:
    """The commands that train on a scene file; one click selects one."""
    style = (
        "user-select:all;white-space:pre-wrap;word-break:break-all;background:#f3f3f5;"
        "padding:6px 8px;border-radius:4px;font-size:12px;margin:4px 0"
    )
    hint = "One click selects a command." if is_saved else "Save the scene first."
    blocks = [f"<pre style='{style}'>{escape(each)}</pre>" for each in training_commands(file)]

    return f"<p style='margin:4px 0'>{hint}</p>{''.join(blocks)}"


def _red(text: str) -> str:
    return f"<span style='color:#b30000'>{escape(text)}</span>"


def _legend(*samples: tuple[str, str]) -> str:
    """Samples of 22 x 14 px, as SVG, each with what it means."""
    return (
        "<div style='font-size:12.5px;line-height:1.6'>"
        + "".join(
            "<span style='white-space:nowrap;margin-right:14px'>"
            f"<svg width='22' height='14' style='vertical-align:-2px'>{shape}</svg> {text}</span>"
            for shape, text in samples
        )
        + "</div>"
    )


PLAN_LEGEND = _legend(
    ("<path d='M11 0 L18 7 L11 14 L4 7Z' fill='#ff8c00'/>", "start"),
    ("<rect x='5' y='1' width='12' height='12' fill='#d7191c'/>", "goal"),
    ("<path d='M11 1 L19 13 L3 13Z' fill='#141418'/>", "access point"),
    ("<rect x='1' y='4' width='20' height='6' fill='#c51b8a'/>", "IRS panel"),
    ("<rect x='2' y='1' width='18' height='12' fill='#141418'/>", "obstacle"),
    ("<rect x='2' y='1' width='18' height='12' fill='#b4c4d8'/>", "pale: below the target"),
    ("<path d='M1 7 H21' stroke='black' stroke-width='3'/>", "shortest path"),
)
CURVE_LEGEND = _legend(
    ("<path d='M1 7 H21' stroke='#26828e' stroke-width='3'/>", "shortest path"),
    ("<path d='M11 0 V14' stroke='black' stroke-width='2'/>", "target"),
    (
        "<path d='M11 0 V14' stroke='#d7191c' stroke-width='2' stroke-dasharray='4 2'/>",
        "highest feasible",
    ),
)
