"""Run the tests of the workbench in a browser, and with ``--draw`` its page and pictures for docs/.

Panel and Playwright lie in an environment of their own on top of this one, so that the other tests
show that nothing else needs them. The browser is a Chromium of the machine (``apt-get install
chromium``).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from clients import ROOT, create, install

PINS = "-c", str(ROOT / "constraints.txt")
TESTS = ("-m", "pytest", "--quiet", "-p", "no:cacheprovider", "tests/workbench")
DRAW = ("-m", "eval", "workbench")


def main(arguments: list[str]) -> int:
    """Returns the exit status."""
    with tempfile.TemporaryDirectory() as name:
        python = create(Path(name))
        install(python, *PINS, "panel", "bokeh", "playwright")
        command = DRAW if arguments == ["--draw"] else TESTS

        return subprocess.run([str(python), *command], check=False, cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
