"""Each script of `examples/` runs as a user would run it, and says what is true."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 300

# What stands in the output of each.
SAYS = {
    "masked_observations": ["with masks: True, refused: 0.0%"],
    "own_map": ["at -80.0 dB: 10.743 m", "at -70.0 dB: 11.864 m"],
    "own_scene": ["paper: 1124 cells", "21.571 m", "factory.json: 1084 cells", "25.056 m"],
    "random_and_oracle": ["random_action: success", "oracle_action: success True, 23.228 m"],
    "sb3_ppo": ["after 1024 steps: success"],
    "tree_search": ["23.228 m after 7376 steps; the oracle needs 23.228 m"],
    "unseen_scenes": ["success 20 of 20", "the oracle's is 1"],
    "value_iteration": ["m off optimal_q", "23.228 m, SPL 1.000"],
}
WORDS = {"sb3_ppo": ["1024"]}
NEEDS = {"sb3_ppo": ["stable_baselines3"]}


def test_every_script_is_tested():
    assert {each.stem for each in ROOT.glob("examples/*.py")} == set(SAYS)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.needs(*NEEDS[name])] if name in NEEDS else [])
        for name in SAYS
    ],
)
def test_script_runs_outside_the_checkout(name, tmp_path):
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / f"{name}.py"), *WORDS.get(name, [])],
        cwd=tmp_path,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=SECONDS,
    )
    assert done.returncode == 0, done.stderr
    assert [phrase for phrase in SAYS[name] if phrase not in done.stdout] == [], done.stdout
