"""`TrainConfig`: all settings of a run, the command line that is made from them, and those of an old run."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import get_args

import tyro
from pydantic import TypeAdapter
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from agents.algorithms import Algorithm
from agents.checkpoint import Run
from agents.dqn import DqnConfig
from agents.manifest import Config
from agents.maskable_ppo import MaskablePpoConfig
from agents.ppo import PpoConfig
from agents.q_learning import QLearningConfig
from agents.qr_dqn import QrDqnConfig
from agents.rollout import arguments_of
from agents.settings import AgentConfig
from irs_gym.radio_map import RadioMap
from irs_gym.scene import Scene
from irs_gym.task import Task, resolved


@dataclass(frozen=True)
class TrainConfig:
    """Train an agent, and keep what it becomes in a run folder.

    The agent is tested from the fixed start again and again; its best state is kept. Ctrl-C ends the run in good order.
    A run that was ended so, or killed, goes on with --resume.
    """

    agent: AgentConfig
    env: Task
    """What is trained on; tests differ from it by the fixed start alone."""
    out: Path | None = None
    """Run folder; None for a new one under runs/, named by algorithm, seed and time."""
    resume: Path | None = None
    """Run folder to go on with, from its last checkpoint. Its own settings hold; none but progress may be given."""
    overwrite: bool = False
    """Whether an old run in that folder is replaced."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same run."""
    eval_every: int = 8192
    """Least number of steps between two tests."""
    stop_at_optimum: bool = True
    """Whether to stop once the oracle's distance is reached and held; the agent itself never sees the oracle."""
    hold: int = 3
    """Tests in a row that must reach the oracle's distance before the run stops."""
    checkpoint_every: int = 50_000
    """Least number of steps between two checkpoints: the most that is lost when the run is killed."""
    tensorboard: bool = False
    """Whether to log for TensorBoard, into the run folder."""
    threads: int = 1
    """Threads of PyTorch; more than one does not pay for networks this small."""
    progress: bool = True
    """Whether to show a progress bar."""

    def __post_init__(self) -> None:
        for name in ("eval_every", "hold", "checkpoint_every", "threads"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}={getattr(self, name)} must be a positive integer")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed={self.seed} must be an integer from 0 to 2**32 - 1")
        if isinstance(self.agent, DqnConfig) and self.agent.n_steps > 1 and self.env.observation == "dict":
            raise ValueError(f"n_steps={self.agent.n_steps} needs observation='flat' or 'map'; 'dict' allows only 1")


# Where paths differ by 2 % only, an agent finds the best one much more surely with starts in many places.
DEFAULTS: dict[Algorithm, TrainConfig] = {
    agent.algorithm: TrainConfig(agent=agent, env=Task(observation="flat", random_start=random_start))
    for agent, random_start in (
        (PpoConfig(), 0.7),
        (MaskablePpoConfig(), 0.7),
        (DqnConfig(), 0.5),
        (QrDqnConfig(), 0.5),
        (QLearningConfig(), 0.5),
    )
}

_OF_THE_CALL = ("out", "resume", "overwrite", "progress")  # not of the run, whose result they do not touch


def record_of(config: TrainConfig) -> Config:
    """What a run folder keeps of the settings; what the environment leaves to its scene is written out."""
    own, whole = ("agent", "env", "seed", *_OF_THE_CALL), resolved(config.env)
    env = replace(config.env, target_db=whole.target_db, phase_bits=whole.phase_bits)
    return Config(
        algorithm=config.agent.algorithm,
        seed=config.seed,
        env=arguments_of(env),
        agent=asdict(config.agent),
        training={name: value for name, value in vars(config).items() if name not in own},
    )


def settings_of(run: Run) -> TrainConfig:
    """Settings of an old run; raises `ValueError` where there can be no such settings."""
    record = run.config
    kind = type(DEFAULTS[record.algorithm].agent)
    agent = TypeAdapter(kind).validate_python(record.agent)
    return TrainConfig(agent=agent, env=run.task, seed=record.seed, resume=run.folder, **record.training)


def parse(algorithm: Algorithm, arguments: Sequence[str]) -> TrainConfig:
    """Settings from a command line; ends the program with a message where it is wrong."""
    return tyro.cli(
        TrainConfig,
        default=DEFAULTS[algorithm],
        args=arguments,
        prog=f"python -m train {algorithm}",
        registry=_registry(),
    )


def _registry() -> ConstructorRegistry:
    """Lets a field that may hold a scene or a map take its name or the path of its file."""
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def _name_or_file(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[str | None] | None:
        if not {Scene, RadioMap} & set(get_args(info.type)):
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="NAME|FILE" if Scene in get_args(info.type) else "FILE",
            instance_from_str=lambda words: words[0],
            is_instance=lambda value: value is None or isinstance(value, str | Path),
            str_from_instance=lambda value: [str(value)],
        )

    return registry
