"""Build the wheel, install it with its core dependencies alone, and step IrsNav-v0 outside the
checkout; then train, score and load a pretrained agent there.
"""

import os
import subprocess
import sys
import sysconfig
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

PLAY = """
from irs_gym.lab import folder, load_pretrained

assert folder().name == "_lab", folder()
score = load_pretrained("ppo", target_db=-61.8).play()
assert score.spl == 1.0, score
print(f"a pretrained agent of the wheel: {score.distance:.3f} m, SPL {score.spl}")
"""
COMMANDS = (
    "train q_learning --out run --agent.total-timesteps 4096",
    "eval score run",
    "eval score planner --split val --num-scenes 3",
    "eval animate ppo --out ppo.gif",
)


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
        *(
            f"irs_gym/_lab/{each.relative_to(ROOT).as_posix()}"
            for name in ("agents", "train", "eval", "models")
            for each in (ROOT / name).rglob("*.*")
            if "__pycache__" not in each.parts
        ),
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


def check_lab(wheel: Path, folder: Path) -> None:
    """Train, score and load a pretrained agent with the wheel installed before, and with PyTorch
    and the others of the Python that runs this.
    """
    scripts = folder / "venv" / "bin"
    python = str(scripts / "python")
    ask = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    own = Path(subprocess.check_output(ask, text=True).strip())
    (own / "below.pth").write_text(
        sysconfig.get_path("purelib") + "\n"
    )  # editable installs are not
    # seen through it: only the folder is added, no .pth file in it is read

    settings = {"OMP_NUM_THREADS": "1", "PYTHONPATH": ""}
    calls = [
        [python, "-c", PLAY],
        *([str(scripts / "irs-gym"), *each.split()] for each in COMMANDS),
    ]
    for call in calls:
        done = subprocess.run(
            call,
            check=False,
            cwd=folder,
            env=os.environ | settings,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            said = done.stdout + done.stderr
            sys.exit(f"{wheel.name}: {' '.join(call)} does not run:\n{said}")
        print(done.stdout.strip())


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        wheel = build(Path(name))
        check_contents(wheel)
        check_installed(wheel, Path(name))
        check_lab(wheel, Path(name))
