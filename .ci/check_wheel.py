"""Build the wheel, install it with its core dependencies alone, and step IrsNav-v0 outside the
checkout.
"""

import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).resolve().parents[1]

STEP_ONCE = """
import gymnasium

env = gymnasium.make("irs_gym:IrsNav-v0", render_mode="rgb_array")
_, info = env.reset(seed=0)
env.step(env.action_space.sample(mask=info["action_mask"]))
height, width, channels = env.render().shape
env.close()
package = __import__("irs_gym").__file__
print(f"{env.spec.id} stepped and rendered at {width} x {height} from {package}")
"""


def build(folder: Path) -> Path:
    """Build the wheel into a folder; returns its path."""
    command = [
        sys.executable,
        "-m",
        "build",
        "--quiet",
        "--wheel",
        "--no-isolation",
        "-o",
        str(folder),
        str(ROOT),
    ]
    subprocess.run(command, check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def check_contents(wheel: Path) -> None:
    """Exit with a message unless the wheel holds the package `irs_gym`, whole, and nothing beside
    it.
    """
    with ZipFile(wheel) as archive:
        files = set(archive.namelist())
    others = {name for name in files if not name.startswith(("irs_gym/", "irs_gym-"))}
    missing = {
        "irs_gym/py.typed",
        "irs_gym/scenes/paper.json",
        "irs_gym/datasets/splits.json",
    } - files
    if others or missing:
        sys.exit(f"{wheel.name}: not of the package: {sorted(others)}; missing: {sorted(missing)}")


def check_installed(wheel: Path, folder: Path) -> None:
    """Install the wheel into an empty environment in the folder and step the environment there."""
    venv.create(folder / "venv", with_pip=True)
    python = str(folder / "venv" / "bin" / "python")
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "-c", str(ROOT / "constraints.txt"), str(wheel)], check=True)
    done = subprocess.run([python, "-I", "-W", "error", "-c", STEP_ONCE], check=False, cwd=folder)
    if done.returncode:
        sys.exit(f"{wheel.name}: the installed package does not run")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        wheel = build(Path(name))
        check_contents(wheel)
        check_installed(wheel, Path(name))
