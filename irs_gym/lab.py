"""`irs-gym` and `load_pretrained`: trainers, scores and pretrained agents wherever this package is.

A checkout has `agents`, `train`, `eval` and `models/` beside `irs_gym`. The wheel holds them below
it, in `_lab`, since their names are too general for site-packages; they are put on the path when
they are asked for.
"""

import os
import runpy
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

OWN = ("convert", "proof", "workbench")  # commands of this package
OF_THE_LAB = ("train", "eval")


def folder() -> Path:
    """Where `agents`, `train`, `eval` and `models/` lie.

    Examples
    --------
    >>> (folder() / "models" / "manifest.json").exists()
    True
    """
    package = Path(__file__).resolve().parent
    installed = package / "_lab"

    return installed if installed.is_dir() else package.parent


def open_lab() -> None:
    """Make `agents`, `train` and `eval` importable, here and in processes that are started from
    here.

    Raises
    ------
    ImportError
        Where one of these names is already another package's.
    """
    where = str(folder())
    if where not in sys.path:
        # right behind this package: what the user has under such a name of his own comes first
        home = Path(__file__).resolve().parents[1]
        places = [n for n, each in enumerate(sys.path) if Path(each).resolve() == home]
        sys.path.insert(places[0] + 1 if places else len(sys.path), where)

    for name in ("agents", *OF_THE_LAB):
        found = find_spec(name)
        if found is None or Path(str(found.origin)).parent.parent != folder():
            place = found.origin if found else "nowhere"
            raise ImportError(f"the package {name!r} that is found is not irs_gym's: {place}")

    inherited = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if where not in inherited:
        os.environ["PYTHONPATH"] = os.pathsep.join([*filter(None, inherited), where])


def load_pretrained(algorithm: str, **arguments: Any) -> Any:
    """`agents.load_pretrained`, which tells the rest: a pretrained agent and its environment.

    It needs the extra ``train``.
    """
    open_lab()
    return import_module("agents").load_pretrained(algorithm, **arguments)


def main() -> int:
    """``irs-gym train ...`` and the others are ``python -m train ...``; returns the exit status."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in (*OF_THE_LAB, *OWN):
        print(f"usage: irs-gym {{{','.join((*OF_THE_LAB, *OWN))}}} [--help]")
        return 0 if name in ("-h", "--help") else 2

    module = f"irs_gym.{name}"
    if name in OF_THE_LAB:
        open_lab()
        module = name

    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)  # leaves by itself

    return 0
