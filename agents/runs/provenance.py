"""Where a result comes from: versions of the packages, the checkout's commit, the processor."""

import platform
import subprocess
from importlib import metadata
from pathlib import Path

import irs_gym

PACKAGES = ("gymnasium", "numpy", "scipy", "torch", "stable_baselines3", "sb3_contrib")
ROOT = Path(__file__).resolve().parents[2]


def versions() -> dict[str, str]:
    """Versions of Python, of `irs_gym`, and of the packages that results hang on, where they are
    installed.
    """
    found = {"python": platform.python_version(), "irs_gym": irs_gym.__version__}

    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue

    return found


def commit() -> str | None:
    """Commit of this checkout, with ``+changes`` where its files differ from it; None outside a git
    checkout.
    """
    if not (ROOT / ".git").exists():
        return None

    try:
        return _git("rev-parse", "HEAD") + ("+changes" if _git("status", "--porcelain") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def processor() -> str:
    """The processor's name, where the system tells it; else its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # no Linux
        lines = []

    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))

    return next(names, "") or platform.processor() or platform.machine()


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=30
    ).stdout.strip()
