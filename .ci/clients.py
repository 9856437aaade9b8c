"""Run the blocks of code for other libraries, and what tests need them, each in an environment of
its own on top of this one.

These libraries pin versions of Gymnasium and others that differ from ours and from each other, so
none of them can be part of ``make test``, which names the blocks that it leaves to this script.
What an environment holds comes first; whatever else is imported is that of the Python that runs
this.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
import venv
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

ROOT = Path(__file__).resolve().parents[1]

# What a block `needs` -> what is installed for it.
CLIENTS: dict[str, tuple[str, ...]] = {
    "tianshou": ("tianshou==2.0.1",),
    "torchrl": ("torchrl==0.14.1",),
    "minari": ("minari[create,hdf5]==0.5.4",),
    "d3rlpy": ("d3rlpy==2.8.1", "minari[hdf5]==0.5.4"),  # pins gymnasium 1.0.0
    # pins gymnasium 0.29 and stable-baselines3 2.2
    "imitation": ("imitation==1.0.1", "minari[hdf5]==0.5.4"),
    "mlcroissant": ("mlcroissant==1.1.1", "minari[hdf5]==0.5.4"),
    "cleanrl": ("gymnasium==0.29.1", "stable-baselines3==2.2.1"),  # its pin, and the last for it
    "ray.rllib": ("ray[rllib]==2.60.0",),  # pins gymnasium 1.2
    "mo_gymnasium": ("mo-gymnasium==1.3.2",),
    "agents.cmdp": ("gdown==6.5.1", "seaborn==0.13.2", "typer==0.29.2", "wandb==0.31.0"),
}
# Installed without what they require: CleanRL's package asks for Python 3.10 and for Gym beside
# Gymnasium, OmniSafe for Safety-Gymnasium, which does not load on Python 3.11, and pandas 2.0.
ALONE = {"cleanrl": ("cleanrl==1.2.0",), "agents.cmdp": ("omnisafe==0.5.0",)}
SOURCE_ONLY = "gym,jsonpath-rw"  # old, pure Python, and never published as wheels
CLEANRL = "https://raw.githubusercontent.com/vwxyzjn/cleanrl/fe8d8a03c41a7ef5b523e2e354bd01c363e786bb/cleanrl/ppo.py"


def create(folder: Path) -> Path:
    """Make an environment in the folder, on top of this one; returns its Python."""
    venv.create(folder, with_pip=True)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / "python"
    ask = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    packages = Path(subprocess.check_output(ask, text=True).strip())
    (packages / "below.pth").write_text(sysconfig.get_path("purelib") + "\n")

    return python


def build(client: str, folder: Path) -> Path:
    """Make the client's environment in the folder; returns its Python."""
    python = create(folder)
    torch = next(
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line.startswith("torch==")
    )
    (folder / "torch.txt").write_text(torch + "\n")
    wheels = ["--only-binary", ":all:", "--no-binary", SOURCE_ONLY, "-c", str(folder / "torch.txt")]
    install(python, *wheels, *CLIENTS[client])
    if client in ALONE:
        install(python, "--no-deps", "--ignore-requires-python", *ALONE[client])
    return python


def install(python: Path, *arguments: str) -> None:
    """Run pip, which complains of pins that differ from what lies below; what it says is shown
    where it fails.
    """
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run([*pip, *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"pip install {' '.join(arguments)}:\n{done.stdout}{done.stderr}")


def fetch_cleanrl(folder: Path) -> dict[str, str]:
    """Where CleanRL's `ppo.py` lies, as a variable: $CLEANRL, if it is set, or fetched; nothing
    without a network.
    """
    if "CLEANRL" in os.environ:
        return {}
    try:
        with urlopen(CLEANRL, timeout=30) as page:
            text = page.read()
    except (URLError, OSError) as error:
        print(
            f"CleanRL's ppo.py has not run: {CLEANRL} cannot be fetched ({error}). "
            "Set CLEANRL to a checkout of it."
        )
        return {}
    (folder / "cleanrl").mkdir()
    (folder / "cleanrl" / "ppo.py").write_bytes(text)
    return {"CLEANRL": str(folder)}


def check(client: str) -> bool:
    """Whether the client's blocks, at least one, pass in an environment of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            python = build(client, folder / "env")
        except RuntimeError as error:
            print(f"{client}: {error}", flush=True)
            return False
        settings = fetch_cleanrl(folder) if client == "cleanrl" else {}

        tests = [
            "-m",
            "pytest",
            "--quiet",
            "-p",
            "no:cacheprovider",
            "tests/test_code_blocks.py",
            "tests/train/test_datasets.py",
            "-k",
            f"needs_{client}",
        ]
        done = subprocess.run(
            [str(python), *tests],
            check=False,
            cwd=ROOT,
            env=os.environ | settings,
            capture_output=True,
            text=True,
        )
        shown = done.stdout.strip().splitlines()
        packages = ", ".join(CLIENTS[client] + ALONE.get(client, ()))
        print(
            f"{client} ({packages}): {shown[-1]}"
            if not done.returncode
            else done.stdout + done.stderr,
            flush=True,
        )
        return not done.returncode


def main(clients: list[str]) -> int:
    """Check the clients of these names, or all; exit status 1 where one fails."""
    unknown = sorted(set(clients) - set(CLIENTS))
    if unknown:
        sys.exit(f"unknown: {', '.join(unknown)}; the clients are {', '.join(CLIENTS)}")
    chosen = clients or list(CLIENTS)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        passed = list(pool.map(check, chosen))
    failed = [client for client, has_passed in zip(chosen, passed, strict=True) if not has_passed]
    print(f"failed: {', '.join(failed)}" if failed else "all clients pass")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
