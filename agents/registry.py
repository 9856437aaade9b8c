"""`ALGORITHMS`: a row for each algorithm, from which command lines, titles, defaults and loaders
derive.

A row names classes by strings, "module:Class", which `config_class`, `learner_class` and
`network_class` import on demand: so the registry imports nothing, and everything may import it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal

Encoding = Literal["mask", "margin"]
Track = Literal["scene", "continuous", "map", "local"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """An algorithm.

    Attributes
    ----------
    title
        Its name on pages.
    track
        What it learns on: one ``"scene"``, one where the robot goes anywhere on the floor
        (``"continuous"``), or many, of which its policies see the whole ``"map"`` or the
        ``"local"`` patch around the robot.
    config
        The frozen dataclass of its settings, with a default for each, and with its name as
        ``algorithm``.
    learner
        What learns. A class of Stable-Baselines3 or sb3-contrib; for one scene, also a class with
        the methods of `agents.single.q_learning.QLearning`; for many scenes, also an
        `agents.learning.map_learner.Teacher`, made of settings, network and random numbers.
    mixes
        The class of Stable-Baselines3 whose policies a learner of our own mixes, as a string.
    network
        What a teacher improves, a network over maps or an explorer's; with Stable-Baselines3, what
        reads observations in front of the policy, if not its own.
    policy
        The class of its policy, where that is none of Stable-Baselines3's own, as a string.
    masked_policy
        That for ``mask_head=True``; None where there is none.
    env, training
        What its runs change in the defaults of their environment, and of their other settings.
    codebook_env, codebook_agent
        What they change further where the robot switches the panel: in the defaults of the
        environment, and in the algorithm's own settings.
    """

    title: str
    track: Track
    config: str
    learner: str
    mixes: str | None = None
    network: str | None = None
    policy: str | None = None
    masked_policy: str | None = None
    env: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)
    codebook_env: Mapping[str, Any] = field(default_factory=dict)
    codebook_agent: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_sb3(self) -> bool:
        """Whether Stable-Baselines3 or sb3-contrib has the learner."""
        return self.learner.startswith(("stable_baselines3", "sb3_contrib"))

    @property
    def is_taught(self) -> bool:
        """Whether a teacher improves its network, on a set of scenes in place of environments."""
        return self.learns_on_many and not self.is_sb3

    @property
    def learns_on_many(self) -> bool:
        """Whether it learns on many scenes, and not on one task."""
        return self.track in ("map", "local")

    @property
    def network_name(self) -> str:
        """What files call its network: the name of the module."""
        return (self.network or "").partition(":")[0].rpartition(".")[2]


def _tested_every(steps: int) -> dict[str, int]:
    return {"eval_every": steps, "checkpoint_every": steps}


# Where the panel is switched, there are as many maps as configurations, and most switches are
# refused: networks that see the mask, and add it to the scores of actions with one weight, soon
# learn not to try them, and those that are told which cells and configurations meet the target
# learn where a switch pays.
_SWITCHING_MASKABLE_PPO: dict[str, Any] = {"signs": True, "gae_lambda": 0.95}
_SWITCHING_PPO: dict[str, Any] = {
    "signs": True,
    "gamma": 0.985,  # nearer to 0, each switch delays the goal by more than it may save
    "mask_head": True,
    "normalize_advantage": False,
    "total_timesteps": 1_500_000,
}
_SWITCHING_DQN: dict[str, Any] = {
    "signs": True,
    "total_timesteps": 1_400_000,
    "exploration_fraction": 0.17,  # 240,000 steps: a longer schedule need not begin more slowly
    "n_envs": 256,
    "batch_size": 256,
    "gradient_steps": 8,
    "buffer_size": 300_000,
    "exploration_final_eps": 0.3,
}

# What lies in the unseen part of a scene is learned from many, and which state was the best is told
# by many.
_MANY_SCENES: dict[str, Any] = {"num_scenes": 8000, "test_scenes": 500}

# Where the robot goes anywhere, no path of a network is as short as the oracle's to the last digit.
_NEVER_EXACT = {"stop_at_optimum": False}
# On one map, where to go follows from where the robot is.
_PLACE = "agents.networks.place_extractor:PlaceExtractor"
# Phases differ from cell to cell, and tell nothing of where to go.
_DRIVING: dict[str, Any] = {
    "random_start": 0.6,
    "on_refused": "stay",  # in tests a robot stops on the border
    "irs_phases": False,
    "patch_radius": 3,
}

# The order is that of command lines and pages. In one scene, where paths differ by 2 % only, an
# agent finds the best one much more surely with starts in many places.
ALGORITHMS: dict[str, Row] = {
    "ppo": Row(
        title="PPO",
        track="scene",
        config="agents.single.ppo:PpoConfig",
        learner="stable_baselines3:PPO",
        masked_policy="agents.networks.mask_policies:MaskActorCriticPolicy",
        env={"random_start": 0.7},
        codebook_env={"observation": "masked", "random_start": 0.9},
        codebook_agent=_SWITCHING_PPO,
    ),
    "maskable_ppo": Row(
        title="MaskablePPO",
        track="scene",
        config="agents.single.maskable_ppo:MaskablePpoConfig",
        learner="sb3_contrib:MaskablePPO",
        env={"random_start": 0.7},
        codebook_env={"random_start": 0.9},
        codebook_agent=_SWITCHING_MASKABLE_PPO,
    ),
    "ppo_lagrangian": Row(
        title="PPO-Lagrangian",
        track="scene",
        config="agents.single.ppo_lagrangian:PpoLagrangianConfig",
        learner="agents.single.ppo_lagrangian:PpoLagrangian",
        mixes="stable_baselines3:PPO",
        env={
            "random_start": 0.7,
            "observation": "dict",
            "patch_radius": 3,
            "irs_phases": False,
            "target_db": -60.0,
            "constraint": "budget",
            "budget": 13.0,
            "on_exhausted": "continue",
            "goal_bonus": 100.0,  # near 10, a discounted detour is hardly worth its way
        },
        training={"stop_at_optimum": False},  # its policies are random, and the oracle's paths not
    ),
    "dqn": Row(
        title="DQN",
        track="scene",
        config="agents.single.dqn:DqnConfig",
        learner="stable_baselines3:DQN",
        masked_policy="agents.networks.mask_policies:MaskDqnPolicy",
        env={"random_start": 0.5},
        codebook_env={
            "observation": "masked",
            "random_start": 0.9,
            "patch_radius": 3,
            "irs_phases": False,
        },
        codebook_agent={**_SWITCHING_DQN, "mask_head": True},
    ),
    "qr_dqn": Row(
        title="QR-DQN",
        track="scene",
        config="agents.single.qr_dqn:QrDqnConfig",
        learner="sb3_contrib:QRDQN",
        env={"random_start": 0.5},
        codebook_env={"observation": "masked"},
        codebook_agent=_SWITCHING_DQN,
    ),
    "q_learning": Row(
        title="Q-learning",
        track="scene",
        config="agents.single.q_learning:QLearningConfig",
        learner="agents.single.q_learning:QLearning",
        env={"random_start": 0.5},
        codebook_agent={"total_timesteps": 3_000_000, "n_envs": 256},
    ),
    "continuous_ppo": Row(
        title="PPO, continuous",
        track="continuous",
        config="agents.single.continuous_ppo:ContinuousPpoConfig",
        learner="stable_baselines3:PPO",
        policy="agents.networks.bounded_policy:BoundedPolicy",
        network=_PLACE,
        env={**_DRIVING, "random_start": 0.9},
        training={**_NEVER_EXACT, "eval_every": 8_192},
    ),
    "sac": Row(
        title="SAC",
        track="continuous",
        config="agents.single.sac:SacConfig",
        learner="stable_baselines3:SAC",
        network=_PLACE,
        env=_DRIVING,
        training=_NEVER_EXACT,
    ),
    "td3": Row(
        title="TD3",
        track="continuous",
        config="agents.single.td3:Td3Config",
        learner="stable_baselines3:TD3",
        network=_PLACE,
        env=_DRIVING,
        training=_NEVER_EXACT,
    ),
    "planner": Row(
        title="planning network, imitation",
        track="map",
        config="agents.learning.map_configs:PlannerConfig",
        learner="agents.learning.imitation:Imitation",
        network="agents.networks.planner:PlanningNetwork",
        training=_tested_every(1_200),
    ),
    "planner_ppo": Row(
        title="planning network, PPO alone",
        track="map",
        config="agents.learning.map_configs:PlannerPpoConfig",
        learner="agents.learning.whole_map_ppo:WholeMapPpo",
        network="agents.networks.planner:PlanningNetwork",
        training=_tested_every(50_000),
    ),
    "unet": Row(
        title="U-Net, imitation",
        track="map",
        config="agents.learning.map_configs:UNetConfig",
        learner="agents.learning.imitation:Imitation",
        network="agents.networks.unet:UNet",
        training=_tested_every(6_000),
    ),
    "unet_ppo": Row(
        title="U-Net, imitation, then PPO",
        track="map",
        config="agents.learning.map_configs:UNetPpoConfig",
        learner="agents.learning.whole_map_ppo:WholeMapPpo",
        network="agents.networks.unet:UNet",
        training=_tested_every(100_000),
    ),
    "vin": Row(
        title="value-iteration network, imitation",
        track="map",
        config="agents.learning.map_configs:VinConfig",
        learner="agents.learning.imitation:Imitation",
        network="agents.networks.vin:ValueIterationNetwork",
        training=_tested_every(3_000),
    ),
    "map_ppo": Row(
        title="PPO (SB3), convolutional",
        track="map",
        config="agents.learning.sb3_configs:MapPpoConfig",
        learner="stable_baselines3:PPO",
        network="agents.networks.map_extractor:MapExtractor",
        training=_tested_every(100_000),
    ),
    "explorer": Row(
        title="explorer: imitation with memory",
        track="local",
        config="agents.learning.local_configs:ExplorerConfig",
        learner="agents.learning.dagger:Dagger",
        network="agents.networks.explorer:ExplorerNetwork",
        env=_MANY_SCENES,
        training=_tested_every(128_000),
    ),
    "explorer_ppo": Row(
        title="explorer: PPO with memory",
        track="local",
        config="agents.learning.local_configs:ExplorerPpoConfig",
        learner="agents.learning.explorer_ppo:ExplorerPpo",
        network="agents.networks.explorer:ExplorerNetwork",
        env=_MANY_SCENES,
        training=_tested_every(48_000),
    ),
    "local_ppo": Row(
        title="PPO (SB3)",
        track="local",
        config="agents.learning.sb3_configs:LocalPpoConfig",
        learner="stable_baselines3:PPO",
        network="agents.networks.local_extractor:LocalExtractor",
        env=_MANY_SCENES,
        training=_tested_every(2_000_000),
    ),
    "recurrent_ppo": Row(
        title="RecurrentPPO (sb3-contrib)",
        track="local",
        config="agents.learning.sb3_configs:RecurrentPpoConfig",
        learner="sb3_contrib:RecurrentPPO",
        network="agents.networks.local_extractor:LocalExtractor",
        env=_MANY_SCENES,
        training=_tested_every(2_000_000),
    ),
}


def specialists() -> tuple[str, ...]:
    """The algorithms that learn in one scene, by moves over its grid."""
    return tuple(name for name, row in ALGORITHMS.items() if row.track == "scene")


def drivers() -> tuple[str, ...]:
    """The algorithms that learn in one scene where the robot goes anywhere on the floor."""
    return tuple(name for name, row in ALGORITHMS.items() if row.track == "continuous")


def generalists() -> tuple[str, ...]:
    """The algorithms that learn on many scenes."""
    return tuple(name for name, row in ALGORITHMS.items() if row.learns_on_many)


def observation_of(algorithm: str) -> Literal["flat", "map"]:
    """The observation of `IrsNavRandom-v0` that a generalist's policies see."""
    return "flat" if ALGORITHMS[algorithm].track == "local" else "map"


def config_class(algorithm: str) -> Any:
    """The class of an algorithm's settings."""
    return named(ALGORITHMS[algorithm].config)


def learner_class(algorithm: str) -> Any:
    """The class that learns by an algorithm."""
    return named(ALGORITHMS[algorithm].learner)


def network_class(name: str) -> Any:
    """The class of the networks over maps, or of the explorers, that files call by that name.

    Raises ``KeyError`` where there is none.
    """
    taught = {row.network_name: row.network for row in ALGORITHMS.values() if row.is_taught}
    return named(taught[name] or "")


def named(text: str) -> Any:
    """What a string "module:name" names, imported now."""
    module, _, name = text.partition(":")
    return getattr(import_module(module), name)
