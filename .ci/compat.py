"""Run the tests of `irs_gym` on each Python at hand, with the latest Gymnasium and the oldest
supported ones.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
LATEST = "gymnasium"
OLDEST = "gymnasium==1.1.*"  # with vector environments
OLDEST_SINGLE = ("gymnasium==0.29.*", "gymnasium==1.0.*")  # single environments alone
NEEDED = ("pytest", "pytest-xdist", "hypothesis", "networkx", "scikit-image")
# Tests that import these read the whole checkout, or need torch, whose wheels come later than a new
# Python.
ABOVE_CORE = re.compile(
    r"^(?:from|import) (?:agents|eval|grimp|train|stable_baselines3|sb3_contrib|torch)\b",
    re.MULTILINE,
)
VECTOR = re.compile(
    r"^(?:from|import) gymnasium\.vector\b.*AutoresetMode|^from irs_gym\.envs\.\w*vector_nav\b",
    re.MULTILINE,
)


def find(version: str) -> str | None:
    """A Python of that version: the one that runs this, one on the path, or one of pyenv's."""
    if version == f"{sys.version_info.major}.{sys.version_info.minor}":
        return sys.executable
    kept = sorted(
        Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(
            f"versions/{version}.*/bin/python"
        )
    )
    for candidate in (shutil.which(f"python{version}"), *reversed(kept)):
        if (
            candidate
            and not subprocess.run(
                [candidate, "-c", ""], capture_output=True, check=False
            ).returncode
        ):
            return str(candidate)
    return None


def check(python: str, gymnasium: str, folder: Path) -> bool:
    """Whether the tests pass on that Python with that Gymnasium, in a new environment in the
    folder.

    With older Gymnasiums, these are the tests that use it; all others would tell the same again.
    Before 1.1, they are those of single environments.
    """
    own = str(folder / "bin" / "python")
    subprocess.run([python, "-m", "venv", str(folder)], check=True)
    pip = [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, str(ROOT), gymnasium, *NEEDED], check=True)
    versions = "sys.version.split()[0], gymnasium.__version__, numpy.__version__"
    say = f"import gymnasium, numpy, sys; print({versions})"
    print(
        "Python, Gymnasium, NumPy:",
        subprocess.check_output([own, "-c", say], text=True).strip(),
        flush=True,
    )
    texts = {file: file.read_text() for file in sorted(ROOT.glob("tests/**/test_*.py"))}
    files = [
        str(file)
        for file, text in texts.items()
        if not ABOVE_CORE.search(text) and (gymnasium == LATEST or "import gymnasium" in text)
    ]
    tests = [own, "-m", "pytest", "--quiet", "-n", "auto", "-p", "no:cacheprovider"]
    if gymnasium in OLDEST_SINGLE:
        files = [
            str(file)
            for file in (*sorted(ROOT.glob("tests/envs/test_*.py")), ROOT / "tests/test_package.py")
            if not VECTOR.search(texts[file]) and not ABOVE_CORE.search(texts[file])
        ]
        tests += ["-k", "not vector"]
    return not subprocess.run([*tests, *files], check=False, cwd=ROOT).returncode


def main() -> int:
    """Check all pairs of Python and Gymnasium, or those asked for; exit status 1 where one fails or
    is missing.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", nargs="+", default=PYTHONS)
    parser.add_argument("--gymnasium", nargs="+", default=(LATEST, OLDEST, *OLDEST_SINGLE))
    asked = parser.parse_args()

    failed = []
    for version in asked.python:
        python = find(version)
        if python is None:
            failed.append(f"Python {version}: there is none")
            continue
        for gymnasium in asked.gymnasium:
            with tempfile.TemporaryDirectory() as folder:
                if not check(python, gymnasium, Path(folder)):
                    failed.append(f"Python {version} with {gymnasium}")
    print(
        "\n".join(f"failed: {each}" for each in failed) or "all pairs of Python and Gymnasium pass"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
