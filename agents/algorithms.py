"""`load`: a model from the content of its file, and the class behind each algorithm's name."""

from importlib import import_module
from io import BytesIO
from typing import Any, Literal, get_args

Algorithm = Literal["ppo", "maskable_ppo", "dqn", "qr_dqn", "q_learning"]
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)

MapGeneralist = Literal["planner", "planner_ppo", "unet", "unet_ppo", "vin", "map_ppo"]  # see the whole map
LocalGeneralist = Literal["explorer", "explorer_ppo", "local_ppo", "recurrent_ppo"]  # see the patch around the robot
Generalist = Literal[MapGeneralist, LocalGeneralist]  # learn on many scenes
Trainable = Literal[Algorithm, Generalist]
LOCAL: tuple[LocalGeneralist, ...] = get_args(LocalGeneralist)
GENERALISTS: tuple[Generalist, ...] = (*get_args(MapGeneralist), *LOCAL)

_CLASSES: dict[Algorithm | Generalist, tuple[str, str]] = {
    "ppo": ("stable_baselines3", "PPO"),
    "maskable_ppo": ("sb3_contrib", "MaskablePPO"),
    "dqn": ("stable_baselines3", "DQN"),
    "qr_dqn": ("sb3_contrib", "QRDQN"),
    "q_learning": ("agents.q_learning", "QLearning"),
    "map_ppo": ("stable_baselines3", "PPO"),
    "local_ppo": ("stable_baselines3", "PPO"),
    "recurrent_ppo": ("sb3_contrib", "RecurrentPPO"),
}


def keeps_arrays(algorithm: Algorithm | Generalist) -> bool:
    """Whether its models are files of plain arrays, and not those of SB3."""
    return algorithm == "q_learning" or algorithm not in _CLASSES


def observation_of(algorithm: Generalist) -> Literal["flat", "map"]:
    """The observation of `IrsNavRandom-v0` that its policies see."""
    return "flat" if algorithm in LOCAL else "map"


def model_class(algorithm: Algorithm | Generalist) -> Any:
    """The class of an algorithm's models, with SB3's ``learn``, ``predict``, ``save`` and ``load``; imported now."""
    module, name = _CLASSES[algorithm]
    return getattr(import_module(module), name)


def load(algorithm: Algorithm | Generalist, content: bytes) -> Any:
    """The model in the content of a file, to act with.

    A network's file is unpickled in part, which runs what stands in it: load only what is known by its SHA-256. Files
    of tables, of networks over maps and of explorers hold plain arrays.
    """
    if algorithm not in _CLASSES:
        return read_network(content)
    # The class of a replay buffer is left out: it is for learning, and SB3 warns of it beside n-step returns.
    left_out = {"replay_buffer_class": None}
    return model_class(algorithm).load(BytesIO(content), device="cpu", custom_objects=left_out)


def read_network(content: bytes) -> Any:
    """The policy in a file of arrays: that of a network over maps, or an explorer.

    Raises ``NetworkFileError``, a ``ValueError``, where the file holds none.
    """
    from agents.explorer_policy import Explorer
    from agents.map_network import unpack_network
    from agents.map_policy import MapPolicy

    name, settings, network = unpack_network(content)
    return Explorer(settings, network) if name == "explorer" else MapPolicy(name, settings, network)
