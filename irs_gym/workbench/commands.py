"""`training_commands`: what to type to train on a scene file."""

import shlex
from pathlib import Path

ALGORITHMS = ("ppo", "dqn")


def training_commands(file: Path) -> tuple[str, ...]:
    """A command for each of two algorithms, with the scene file and a run folder of its name.

    Examples
    --------
    >>> training_commands(Path("my scenes/hall.json"))[0]
    "python -m train ppo --env.scene 'my scenes/hall.json' --out runs/hall-ppo"
    """
    return tuple(
        f"python -m train {algorithm} --env.scene {shlex.quote(str(file))} "
        f"--out {shlex.quote(f'runs/{file.stem}-{algorithm}')}"
        for algorithm in ALGORITHMS
    )
