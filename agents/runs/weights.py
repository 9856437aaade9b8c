"""`pack` and `load`: a model's file, which holds plain arrays, and the policy that is rebuilt
around them.

The file holds the weights that act, and `agents.runs.manifest.Config` all else that makes the
policy: the algorithm, its
settings, and the environment, whose observations it sees. Nothing is unpickled.
"""

from collections.abc import Mapping
from io import BytesIO
from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from agents.networks.map_network import FILE_BYTES
from agents.policies.model_file import read_network
from agents.registry import ALGORITHMS, config_class, learner_class, observation_of
from agents.rollout.episode import SceneTask, evaluation_env
from agents.runs.manifest import Config
from agents.single.config import Sb3Config
from agents.single.model import first_layer, policy_kwargs, policy_name
from irs_gym.datasets.splits import split_of
from irs_gym.files import read_arrays
from irs_gym.grid import MOVES
from irs_gym.mdp.packing import Packing
from irs_gym.mdp.task import Task

_IDLE = (
    "value_net",
    "target",
    "lstm_critic",
    "vf_features_extractor",
)  # parts of names: for training alone
_IRS_OF_MANY_SCENES = 3  # numbers that an observation of `IrsNavRandom-v0` tells of the IRS


class WeightsError(ValueError):
    """A file that does not hold the weights of its configuration's policy."""


def pack(config: Config, model: Any) -> bytes:
    """The content of a model's file, of arrays alone; equal weights give equal bytes.

    Of a model of Stable-Baselines3 it holds what acts, without its critic or target network.
    """
    content = BytesIO()
    if not ALGORITHMS[config.algorithm].is_sb3:
        model.save(content)
        return content.getvalue()

    weights = {
        name: each.numpy() for name, each in model.policy.state_dict().items() if _acts(name)
    }
    np.savez_compressed(content, **weights)

    return content.getvalue()


def load(config: Config, task: SceneTask | None, content: bytes) -> Any:
    """The policy in the content of a model's file, to act with.

    Parameters
    ----------
    config
        Of the run that has learned it.
    task
        The environment that it has learned in; None for many scenes.

    Raises
    ------
    OSError
        Where a scene or map file of the task cannot be read.
    ValueError
        `WeightsError` where the file is damaged or does not fit the configuration; also where the
        task cannot be made.
    """
    if ALGORITHMS[config.algorithm].is_sb3:
        return _rebuild(config, *_spaces_of(config, task), _read(content))

    # asked for outside of what is tried: a task that cannot be made is no fault of the file
    env: Any = None if task is None else evaluation_env(task)
    try:
        if env is None:
            return read_network(content)

        return learner_class(config.algorithm).of(
            read_arrays(content, limit=FILE_BYTES),
            env.unwrapped.world.feasible.shape,
            actions_of(env.action_space),
        )
    except ValueError as error:
        raise WeightsError(str(error)) from None


def _read(content: bytes) -> dict[str, NDArray[Any]]:
    try:
        return read_arrays(content, limit=FILE_BYTES)
    except ValueError as error:
        raise WeightsError(str(error)) from None


def _spaces_of(config: Config, task: SceneTask | None) -> tuple[spaces.Space[Any], int]:
    """What the policy sees, and how many actions it has."""
    if task is not None:
        env = evaluation_env(task)
        return env.observation_space, actions_of(env.action_space)

    seen = observation_of(config.algorithm)
    frame = split_of(str(config.env.get("split"))).frame

    return Packing(seen, 2 * Task.patch_radius + 1, _IRS_OF_MANY_SCENES, frame).space, len(MOVES)


def actions_of(space: Any) -> int:
    """How many actions there are in a discrete space."""
    return int(space.n)


def _rebuild(
    config: Config, space: spaces.Space[Any], actions: int, weights: Mapping[str, NDArray[Any]]
) -> Any:
    """The policy of Stable-Baselines3 with these weights, which must be all that act."""
    import torch

    try:
        agent = TypeAdapter(config_class(config.algorithm)).validate_python(config.agent)
    except ValidationError as error:
        raise WeightsError(
            f"its settings are wrong: {error.errors(include_url=False)[0]['msg']}"
        ) from None

    if _least(agent, space, actions) > sum(
        each.size for each in weights.values()
    ):  # before networks are made that fill memory
        raise WeightsError("it does not fit its configuration, whose networks are larger")

    make = learner_class(config.algorithm).policy_aliases[policy_name(agent, space)]
    policy = make(space, spaces.Discrete(actions), lambda _: 0.0, **policy_kwargs(agent))
    wanted = {
        name: _kind(each.numpy()) for name, each in policy.state_dict().items() if _acts(name)
    }
    found = {name: _kind(each) for name, each in weights.items()}

    for name in sorted({*wanted, *found}):
        if found.get(name) != wanted.get(name):
            raise WeightsError(
                f"it does not fit its configuration: {name} is {found.get(name, 'missing')}, "
                f"not {wanted.get(name, 'asked for')}"
            )

    policy.load_state_dict(
        {name: torch.from_numpy(each) for name, each in weights.items()}, strict=False
    )
    policy.set_training_mode(False)

    return policy


def _least(agent: Sb3Config, space: spaces.Space[Any], actions: int) -> int:
    """Numbers that the networks of these settings hold at the least."""
    first = first_layer(agent, space)
    last = actions * getattr(agent, "n_quantiles", 1)
    return sum(before * behind for before, behind in pairwise((first, *agent.net_arch, last)))


def _acts(name: str) -> bool:
    # `features_extractor` is the actor's own by another name.
    return not name.startswith("features_extractor.") and not any(part in name for part in _IDLE)


def _kind(array: NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}"
