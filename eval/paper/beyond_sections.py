"""Sections of docs/paper.md beyond the paper: exact trade-offs, exact levels, the grid, a second
scene, cost.
"""

from collections.abc import Sequence
from math import isfinite, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.markdown import Promise, page, picture, promises, table
from eval.paper.scaling import LEFT_OUT, TARGET_DB, ScalingCost
from eval.paper.study import CONTINUOUS, ONE_BIT, SCHEMES, THREE_BIT, TWO_BIT, Study


def trade_off_section(study: Study) -> str:
    """Every breakpoint of Fig. 5."""
    rows = []

    for scheme in SCHEMES:
        curve = study.curve(scheme)
        gain_db = study.radio_map(scheme).gain_db
        steps = "; ".join(
            f"{length:.3f} m up to {target:.4f} dB"
            for target, length in zip(curve.targets_db, curve.distances, strict=True)
        )
        rows.append((scheme.name, steps, curve.dijkstra_runs, distinct_gains(gain_db)))

    return page(
        "## The exact trade-off",
        "`irs_gym.trade_off` gives the distance as a step function of the target. All shortest "
        "paths at a target make a directed graph; the widest path in it, found by bisection, is "
        "where the step ends; so it takes one run of Dijkstra's algorithm a step. Trying every "
        "gain of the map takes as many runs as there are distinct gains.",
        table(("scheme", "steps", "Dijkstra runs", "distinct gains"), rows),
    )


def distinct_gains(gain_db: NDArray[np.float64]) -> int:
    """How many gains a map holds, those of obstacles left out; gains that rounding alone keeps
    apart are one.
    """
    gains = np.sort(gain_db[np.isfinite(gain_db)])
    return int(np.count_nonzero(np.diff(gains) > 1e-9)) + min(1, len(gains))


def optimal_section(study: Study) -> str:
    """What exact levels gain over rounding."""
    rows = []

    for scheme in (ONE_BIT, TWO_BIT, THREE_BIT):
        nearest, optimal = (study.radio_map(scheme, name) for name in ("nearest", "optimal"))
        gain = (optimal.gain_db[nearest.free] - nearest.gain_db[nearest.free]).tolist()
        raised = study.threshold(scheme, "optimal") - study.threshold(scheme, "nearest")
        rows.append((scheme.name, f"{np.mean(gain):.4f}", f"{max(gain):.3f}", f"{raised:+.4f}"))

    header = ("phases", "mean over free cells (dB)", "largest (dB)", "highest feasible target (dB)")

    return page(
        "## Optimal levels instead of rounded ones",
        "The best of all L^N settings of b-bit phases, found exactly in O(N log N) a cell "
        '(`quantiser="optimal"`; '
        "arXiv 2211.04704, arXiv 2211.04167, and the comment on them by Pekcan and Ayanoglu), "
        "against the nearest levels:",
        table(header, rows),
        picture(
            "optimal_quantiser",
            "What the optimal 1-bit levels gain over the nearest ones, cell by cell.",
        ),
    )


def grid_section(rows: Sequence[tuple[float, float, float]]) -> str:
    """What the eight directions cost."""
    lines = [
        (f"{target:.3f}", f"{oracle:.3f}", f"{bound:.3f}", f"{100 * (oracle / bound - 1):.2f} %")
        for target, oracle, bound in rows
    ]
    header = ("target up to (dB)", "oracle (m)", "any shape (m)", "the grid costs")
    return page(
        "## What the grid costs",
        "`irs_gym.straight_line_bound` is the exact shortest path of any shape inside the "
        "feasible cells, from centre to centre. No path of the grid can be shorter, so this is "
        "what a robot free of the eight directions could save at most. Continuous phases:",
        table(header, lines),
        picture(
            "cost_of_grid", "The oracle's distance and the straight-line bound over the target."
        ),
    )


def own_scene_section(study: Study, target_db: float) -> str:
    """The second scene of the package."""
    scene = study.scene
    without = Study(scene.with_irs_elements(0), study.cell_size)
    header = ("panels", "feasible up to (dB)", "distance at low targets (m)", "at the highest (m)")
    rows = []

    for name, each in (("both", study), ("none", without)):
        steps = each.curve(CONTINUOUS)
        ends = (steps.targets_db[-1], steps.distances[0], steps.distances[-1])
        rows.append((name, *(f"{end:.3f}" for end in ends)))

    lengths = [each.distance(CONTINUOUS, target_db) for each in (study, without)]

    return page(
        "## A second scene",
        f'`irs_gym.load_scene("{scene.name}")`: {scene.room.x_max - scene.room.x_min:g} x '
        f"{scene.room.y_max - scene.room.y_min:g} m, {len(scene.access_points)} access points, "
        f"{len(scene.irs_panels)} panels. A cell is served by the access point of the highest "
        "gain. The panels' line-of-sight parts add coherently and their scattered parts are "
        "independent, so Lemma 1 keeps its form with sums over the panels (last row of the "
        "corrections above).",
        table(header, rows),
        picture(scene.name, f"Map and shortest path at {target_db:.2f} dB, continuous phases."),
        f"At that target the path is {lengths[0]:.3f} m long; without the panels "
        + (f"it is {lengths[1]:.3f} m." if isfinite(lengths[1]) else "there is none."),
    )


ELSEWHERE = (
    "## Maps from elsewhere\n\n"
    "A measured or traced map serves in place of the closed form (`RadioMap.from_array`, "
    "`RadioMap.load`,\n"
    "`irs_gym.from_sionna`). [sionna.md](sionna.md) shows the paper's room traced by Sionna RT "
    "beside the model."
)


# --- cost -----------------------------------------------------------------------------------------


def cost_promises(costs: Sequence[ScalingCost]) -> list[Promise]:
    """What we say of time and memory."""
    maps = [cost for cost in costs if cost.task.startswith("map")]
    small = min((cost for cost in maps if "continuous" in cost.task), key=lambda cost: cost.cells)
    peak = max(cost.peak_mib for cost in maps)

    # of each size, how far the packages' distances are apart
    lengths: dict[int, list[float]] = {}
    for cost in costs:
        if cost.distance is not None:
            lengths.setdefault(cost.cells, []).append(cost.distance)

    apart = max(max(each) - min(each) for each in lengths.values())
    growth = {
        task: _growth([cost for cost in costs if cost.task == task])
        for task in sorted({cost.task for cost in maps})
    }
    exponents = [f"{task.removeprefix('map, ')} {a:.2f}" for task, a in growth.items()]

    return [
        Promise(
            f"{small.task}, {small.cells:,} cells: under 5 ms",
            f"{1e3 * small.seconds:.2f} ms",
            small.seconds < 5e-3,
        ),
        Promise("any map: under 1 GiB of peak memory", f"{peak:.0f} MiB", peak < 1024),
        Promise(
            "maps: time grows linearly with the cells, as cells^a with a < 1.2",
            ", ".join(exponents),
            max(growth.values()) < 1.2,
        ),
        Promise("all packages find the same distance, to 1e-9 m", f"{apart:.0e} m", apart < 1e-9),
    ]


def _growth(costs: Sequence[ScalingCost]) -> float:
    """Exponent of time over cells, up to the largest map from the one after the smallest, which is
    all overhead.
    """
    ordered = sorted(costs, key=lambda cost: cost.cells)
    first = ordered[1]
    last = ordered[-1]

    return log(last.seconds / first.seconds) / log(last.cells / first.cells)


def cost_section(machine: dict[str, Any], costs: Sequence[ScalingCost]) -> str:
    """Time and memory over the number of cells."""
    sizes = sorted({cost.cells for cost in costs if cost.cells})  # the imports alone have none
    by_task: dict[str, dict[int, ScalingCost]] = {}

    for cost in costs:
        by_task.setdefault(cost.task, {})[cost.cells] = cost

    rows = [
        (task, *(_cost_cell(task, cells, of_task.get(cells)) for cells in sizes))
        for task, of_task in by_task.items()
        if task != "imports alone"
    ]
    where = ", ".join(
        f"{name} {value}" for name, value in machine.items() if name not in ("processor", "cores")
    )
    idle = next(cost.peak_mib for cost in costs if cost.task == "imports alone")

    return page(
        "## Cost",
        "Seconds of the fastest of 1 to 50 runs, and peak memory of the whole process "
        f"({idle:.0f} MiB of it the interpreter and the imports of irs_gym), each in a process of "
        f"its own. Maps count from the scene file on, paths at {TARGET_DB:g} dB from the feasible "
        "map on: irs_gym's graph and Dijkstra, scikit-image's `MCP_Geometric`, and networkx's "
        f"graph and `bidirectional_dijkstra`. {machine['processor']}, {machine['cores']} cores, "
        f"{where}.",
        table(("task", *(f"{cells:,} cells" for cells in sizes)), rows),
        promises(cost_promises(costs)),
    )


def _cost_cell(task: str, cells: int, cost: ScalingCost | None) -> str:
    if cost is None:
        return "left out: minutes" if (task, round(cells**0.5)) in LEFT_OUT else ""
    return f"{cost.seconds:.3g} s, {cost.peak_mib:.0f} MiB"
