"""`python -m eval workbench`: the workbench in a browser, its redraws timed and its page drawn."""

import os
import platform
import sys
from pathlib import Path

import numpy as np

from eval.visit import TEXT, visit

_DRAGS = 100
_BEGIN = (0.0, 0.0)  # in the middle obstacle of the paper's scene


def main(out: Path = Path("docs")) -> int:
    """Drag an obstacle a hundred times, tell how long a redraw takes, and write
    docs/figures/workbench.png.

    Parameters
    ----------
    out
        Folder of the figures' folder.
    """
    try:
        with visit(Path()) as found:
            found.watch_redraws()
            found.take(_BEGIN)
            for n in range(_DRAGS):
                found.move((0.25 * (n % 5) - 0.5, -0.25 * (n % 8)))  # another place each time
            found.move((0.0, -1.5))
            found.drop()
            redraws = np.array(found.redraws())

            for policy in ("explorer", "planner"):
                found.page.get_by_label(policy, exact=True).check()
                found.page.wait_for_function(f"({TEXT})().includes('{policy}: ')")
            found.page.wait_for_function(f"!({TEXT})().includes('...')")
            picture = out / "figures" / "workbench.png"
            found.page.screenshot(path=picture)
    except (ModuleNotFoundError, RuntimeError) as error:
        print(f"python -m eval workbench: {error}", file=sys.stderr)
        return 2

    median, high = np.percentile(redraws, [50, 95])
    load = os.getloadavg()[0]
    print(
        f"{len(redraws)} redraws, from the pointer to the screen: median {median:.0f} ms, "
        f"95th percentile {high:.0f} ms; {platform.machine()}, {os.cpu_count()} cores, "
        f"load {load:.1f}"
    )
    print(f"written: {picture}")

    return 0
