"""`TrainConfig` and `GeneralistConfig`: settings of a run, the command line made from them, and
those of an old run.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_args

import tyro
from pydantic import TypeAdapter, ValidationError
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from agents.registry import ALGORITHMS, config_class
from agents.rollout.episode import SceneTask, arguments_of, check_one_scene, env_id_of
from agents.runs.manifest import Config
from agents.runs.run_folder import Run, RunError
from agents.single.config import check_settings
from agents.single.dqn import DqnConfig
from agents.single.ppo_lagrangian import PpoLagrangianConfig, check_bound
from irs_gym.datasets.codebook_task import CodebookKind, CodebookTask
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.datasets.splits import split_of
from irs_gym.mdp.task import Task, resolved
from irs_gym.radio.codebook import Codebook
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Settings of every run."""

    out: Path | None = None
    """Run folder; None for a new one under runs/, named by algorithm, seed and time."""
    resume: Path | None = None
    """Run folder to go on with, from its last checkpoint. Its own settings hold; none but progress
    and trust may be given."""
    trust: bool = False
    """Whether to resume a run folder that you have not made on this machine. That runs code which
    is stored in its checkpoint, with all your rights: only say so where you trust whoever made
    it."""
    overwrite: bool = False
    """Whether an old run in that folder is replaced."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same run."""
    eval_every: int = 8192
    """Least number of steps between two tests."""
    checkpoint_every: int = 50_000
    """Least number of steps between two checkpoints: the most that is lost when the run is killed.
    """
    tensorboard: bool = False
    """Whether to log for TensorBoard, into the run folder."""
    threads: int = 1
    """Threads of PyTorch; more than one does not pay for networks this small."""
    progress: bool = True
    """Whether to show a progress bar."""

    def __post_init__(self) -> None:
        check_settings(self, "whole", "eval_every", "checkpoint_every", "threads")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"seed={self.seed} must be an integer from 0 to 2**32 - 1")


@dataclass(frozen=True, kw_only=True)
class TrainConfig(RunConfig):
    """Train an agent, and keep what it becomes in a run folder.

    The agent is tested from the fixed start again and again; its best state is kept. Ctrl-C ends
    the run in good order. A run that was ended so, or killed, goes on with --resume.
    """

    agent: Any
    env: SceneTask
    """What is trained on; tests differ from it by the fixed start alone. With a codebook,
    `IrsNavCodebook-v0`, whose other arguments ``--env.codebook cover 8 --help`` tells."""
    stop_at_optimum: bool = True
    """Whether to stop once the oracle's distance is reached and held; the agent itself never sees
    the oracle.
    """
    hold: int = 3
    """Tests in a row that must reach the oracle's distance before the run stops."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "hold")
        check_one_scene(self.env)
        goes_anywhere = ALGORITHMS[self.agent.algorithm].track == "continuous"
        if goes_anywhere != isinstance(self.env, ContinuousTask):
            needed = "IrsNavContinuous-v0" if goes_anywhere else "moves over a grid"
            raise ValueError(
                f"{self.agent.algorithm} learns in {needed}, not in {env_id_of(self.env)}"
            )
        if isinstance(self.agent, PpoLagrangianConfig):
            check_bound(self.env.rules)
        if getattr(self.agent, "mask_head", False):
            self._check_mask_head()
        if (
            isinstance(self.agent, DqnConfig)
            and self.agent.n_steps > 1
            and self.env.observation in ("dict", "masked")
        ):
            seen = self.env.observation
            raise ValueError(
                f"n_steps={self.agent.n_steps} needs observation='flat' or 'map'; "
                f"{seen!r} allows only 1"
            )

    def _check_mask_head(self) -> None:
        if ALGORITHMS[self.agent.algorithm].masked_policy is None:
            able = " and ".join(name for name, row in ALGORITHMS.items() if row.masked_policy)
            raise ValueError(
                f"mask_head=True is for {able}, not for {self.agent.algorithm}: leave it False"
            )
        if self.env.observation != "masked":
            raise ValueError(
                f"mask_head=True needs observation='masked'; {self.env.observation!r} has no mask"
            )


@dataclass(frozen=True, kw_only=True)
class Scenes:
    """What a generalist is trained and tested on."""

    split: str = "train"
    """Scenes to learn on, see `irs_gym.datasets.splits.SPLITS`."""
    num_scenes: int = 3000
    """How many."""
    test_split: str = "val"
    """Scenes to test it on."""
    test_scenes: int = 200
    """How many."""

    def __post_init__(self) -> None:
        check_settings(self, "whole", "num_scenes", "test_scenes")
        for split, number in (("split", "num_scenes"), ("test_split", "test_scenes")):
            size = split_of(getattr(self, split)).size
            if getattr(self, number) > size:
                raise ValueError(
                    f"{number}={getattr(self, number)}: "
                    f"there are {size} in {getattr(self, split)!r}"
                )


@dataclass(frozen=True, kw_only=True)
class GeneralistConfig(RunConfig):
    """Train an agent on many scenes, and keep what it becomes in a run folder.

    The agent is tested again and again on scenes that it does not learn on; its best state is that
    of the greatest mean SPL. Steps are those of PPO's robots; in imitation, scenes seen. Ctrl-C
    ends the run in good order. A run that was ended so, or killed, goes on with --resume.
    """

    agent: Any
    env: Scenes = Scenes()


CODEBOOK_FLAG = "--env.codebook"
_OF_THE_CALL = (
    "out",
    "resume",
    "trust",
    "overwrite",
    "progress",
)  # not of the run, whose result they do not touch


def defaults_of(algorithm: str) -> TrainConfig | GeneralistConfig:
    """The tuned settings of an algorithm; raises ``KeyError`` for an unknown one."""
    row = ALGORITHMS[algorithm]
    agent = config_class(algorithm)()
    if row.learns_on_many:
        return GeneralistConfig(agent=agent, env=Scenes(**row.env), **row.training)

    kind = ContinuousTask if row.track == "continuous" else Task
    env = kind(**{"observation": "flat", **row.env})

    return TrainConfig(agent=agent, env=env, **row.training)


def with_codebook(config: TrainConfig) -> TrainConfig:
    """The tuned settings of the same algorithm where the robot switches the panel."""
    row = ALGORITHMS[config.agent.algorithm]
    known = {each.name for each in fields(CodebookTask)}
    own = {name: value for name, value in arguments_of(config.env).items() if name in known}

    return replace(
        config,
        agent=replace(config.agent, **row.codebook_agent),
        env=CodebookTask(**{**own, **row.codebook_env}),
    )


def record_of(config: TrainConfig | GeneralistConfig) -> Config:
    """What a run folder keeps of the settings; what the environment leaves to its scene is written
    out.
    """
    own = ("agent", "env", "seed", *_OF_THE_CALL)
    env = config.env
    if isinstance(env, Task):
        whole = resolved(env).arguments
        env = replace(env, target_db=whole.target_db, phase_bits=whole.phase_bits)
    elif isinstance(env, CodebookTask):
        whole = resolved(env.one_scene).arguments
        bits = None if env.is_made else whole.phase_bits  # what is made holds its phases
        env = replace(env, target_db=whole.target_db, phase_bits=bits)
    elif isinstance(env, ContinuousTask):
        whole = resolved(env.one_scene()).arguments
        env = replace(env, target_db=whole.target_db, phase_bits=whole.phase_bits)

    return Config(
        algorithm=config.agent.algorithm,
        seed=config.seed,
        env=arguments_of(env),
        agent=asdict(config.agent),
        training={name: value for name, value in vars(config).items() if name not in own},
    )


def settings_of(run: Run) -> TrainConfig | GeneralistConfig:
    """Settings of an old run; raises `ValueError` where there can be no such settings."""
    record = run.config
    default = defaults_of(record.algorithm)

    try:
        agent = TypeAdapter(type(default.agent)).validate_python(record.agent)
        env: Any = (
            TypeAdapter(Scenes).validate_python(record.env) if run.is_generalist else run.task
        )
        return type(default)(
            agent=agent, env=env, seed=record.seed, resume=run.folder, **record.training
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise RunError(f"{str(run.folder / 'config.json')!r}: {where}: {first['msg']}") from None
    except TypeError as error:
        raise RunError(f"{str(run.folder / 'config.json')!r}: {error}") from None


def parse(algorithm: str, arguments: Sequence[str]) -> TrainConfig | GeneralistConfig:
    """Settings from a command line; ends the program with a message where it is wrong."""
    default = defaults_of(algorithm)
    has_codebook = any(each.split("=")[0] == CODEBOOK_FLAG for each in arguments)
    if has_codebook and isinstance(default.env, Task):
        default = with_codebook(default)

    return tyro.cli(
        type(default),
        default=default,
        args=arguments,
        prog=f"python -m train {algorithm}",
        config=(tyro.conf.AvoidSubcommands,),
        registry=_registry(),
    )


def _codebook_rule() -> PrimitiveConstructorSpec[Any]:
    """A design and a size, or the path of a file."""

    def read(words: list[str]) -> Any:
        if len(words) == 1 and words[0] not in get_args(CodebookKind):
            return words[0]
        if len(words) == 2 and words[1].isdecimal():
            return words[0], int(words[1])
        raise ValueError("give a design and a size, such as cover 8, or the path of a file")

    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="DESIGN SIZE|FILE",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, Codebook | str | Path | tuple),
        str_from_instance=lambda value: (
            [str(each) for each in value] if isinstance(value, tuple) else [str(value)]
        ),
    )


def _registry() -> ConstructorRegistry:
    """Lets a field that may hold a scene, a map or a codebook take its name or the path of its
    file.
    """
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def _name_or_file(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[str | None] | None:
        if Codebook in get_args(info.type):
            return _codebook_rule()
        if not {Scene, RadioMap, SceneSet} & set(get_args(info.type)):
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="NAME|FILE" if Scene in get_args(info.type) else "FILE",
            instance_from_str=lambda words: words[0],
            is_instance=lambda value: value is None or isinstance(value, str | Path),
            str_from_instance=lambda value: [str(value)],
        )

    return registry
