"""The algorithms by their names, and the classes behind them: `model_class`, `settings_class`,
`read_network`.
"""

from importlib import import_module
from typing import Any, Literal, get_args

NetworkName = Literal["planner", "unet", "vin", "explorer"]
Encoding = Literal["mask", "margin"]

Algorithm = Literal["ppo", "maskable_ppo", "dqn", "qr_dqn", "q_learning"]
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)

MapGeneralist = Literal[
    "planner", "planner_ppo", "unet", "unet_ppo", "vin", "map_ppo"
]  # see the whole map
LocalGeneralist = Literal[
    "explorer", "explorer_ppo", "local_ppo", "recurrent_ppo"
]  # see the patch around the robot
Generalist = Literal[MapGeneralist, LocalGeneralist]  # learn on many scenes
Trainable = Literal[Algorithm, Generalist]
LOCAL: tuple[LocalGeneralist, ...] = get_args(LocalGeneralist)
GENERALISTS: tuple[Generalist, ...] = (*get_args(MapGeneralist), *LOCAL)

MODEL_CLASSES: dict[Algorithm | Generalist, tuple[str, str]] = {
    "ppo": ("stable_baselines3", "PPO"),
    "maskable_ppo": ("sb3_contrib", "MaskablePPO"),
    "dqn": ("stable_baselines3", "DQN"),
    "qr_dqn": ("sb3_contrib", "QRDQN"),
    "q_learning": ("agents.single.q_learning", "QLearning"),
    "map_ppo": ("stable_baselines3", "PPO"),
    "local_ppo": ("stable_baselines3", "PPO"),
    "recurrent_ppo": ("sb3_contrib", "RecurrentPPO"),
}
_SETTINGS: dict[Algorithm | Generalist, tuple[str, str]] = {
    "ppo": ("agents.single.ppo", "PpoConfig"),
    "maskable_ppo": ("agents.single.maskable_ppo", "MaskablePpoConfig"),
    "dqn": ("agents.single.dqn", "DqnConfig"),
    "qr_dqn": ("agents.single.qr_dqn", "QrDqnConfig"),
    "map_ppo": ("agents.learning.local_configs", "MapPpoConfig"),
    "local_ppo": ("agents.learning.local_configs", "LocalPpoConfig"),
    "recurrent_ppo": ("agents.learning.local_configs", "RecurrentPpoConfig"),
}
STABLE_BASELINES = tuple(_SETTINGS)  # the algorithms of Stable-Baselines3 and sb3-contrib


def observation_of(algorithm: Generalist) -> Literal["flat", "map"]:
    """The observation of `IrsNavRandom-v0` that its policies see."""
    return "flat" if algorithm in LOCAL else "map"


def model_class(algorithm: Algorithm | Generalist) -> Any:
    """The class that learns by an algorithm, with SB3's ``learn`` and ``predict``; imported now."""
    module, name = MODEL_CLASSES[algorithm]
    return getattr(import_module(module), name)


def settings_class(algorithm: Algorithm | Generalist) -> Any:
    """The class of the settings of one of `STABLE_BASELINES`; imported now."""
    module, name = _SETTINGS[algorithm]
    return getattr(import_module(module), name)
