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
from agents.single.mixture import Mixture
from agents.single.model import first_layer, policy_class, policy_kwargs
from irs_gym.datasets.splits import split_of
from irs_gym.files import read_arrays
from irs_gym.grid import MOVES
from irs_gym.mdp.packing import Packing
from irs_gym.mdp.task import Task

_IDLE = (
    "value_net",
    "target",
    "critic",
    "vf_features_extractor",
)  # parts of names: for training alone
_ROUNDING = 1e-9
_IRS_OF_MANY_SCENES = 3  # numbers that an observation of `IrsNavRandom-v0` tells of the IRS


class WeightsError(ValueError):
    """A file that does not hold the weights of its configuration's policy."""


def pack(config: Config, model: Any) -> bytes:
    """The content of a model's file, of arrays alone; equal weights give equal bytes.

    Of a model of Stable-Baselines3 it holds what acts, without its critic or target network.
    """
    content = BytesIO()
    row = ALGORITHMS[config.algorithm]
    if not (row.is_sb3 or row.mixes):
        model.save(content)
        return content.getvalue()

    arrays: dict[str, Any] = _mixed(model.mixture) if row.mixes else _weights(model.policy)
    np.savez_compressed(content, **arrays)

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
    row = ALGORITHMS[config.algorithm]
    if row.mixes:
        return _remix(config, *_spaces_of(config, task), _read(content))
    if row.is_sb3:
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


def _weights(policy: Any) -> dict[str, NDArray[Any]]:
    """The weights of a policy of Stable-Baselines3 that act."""
    return {name: each.numpy() for name, each in policy.state_dict().items() if _acts(name)}


def _mixed(mixture: Mixture) -> dict[str, NDArray[Any]]:
    """The weights of the policies of a mixture, with their numbers before the names."""
    arrays = {"shares": mixture.shares, "rounds": mixture.rounds}
    for number, policy in enumerate(mixture.policies):
        arrays |= {f"{number}.{name}": each for name, each in _weights(policy).items()}

    return arrays


def _remix(
    config: Config,
    space: spaces.Space[Any],
    actions: spaces.Space[Any],
    arrays: dict[str, NDArray[Any]],
) -> Mixture:
    """The mixture of the policies with these weights."""
    shares = arrays.pop("shares", np.zeros(0))
    rounds = arrays.pop("rounds", np.zeros(0))
    are_shares = shares.dtype == np.float64 and shares.ndim == 1 and (shares > 0).all()
    if not are_shares or abs(shares.sum() - 1.0) > _ROUNDING:
        raise WeightsError("its shares of policies are not positive numbers that sum to 1")
    if rounds.dtype != np.float64 or rounds.shape[1:] != (3,):
        raise WeightsError(f"its rounds are {_kind(rounds)}, not float64 of shape (R, 3)")

    parts: list[dict[str, NDArray[Any]]] = [{} for _ in shares]
    for name, each in arrays.items():
        number, _, own = name.partition(".")
        if number not in map(str, range(len(parts))):
            raise WeightsError(f"{name} belongs to none of its {len(parts)} policies")
        parts[int(number)][own] = each

    policies = [_rebuild(config, space, actions, part) for part in parts]

    return Mixture(policies, shares, config.seed, rounds)


def _read(content: bytes) -> dict[str, NDArray[Any]]:
    try:
        return read_arrays(content, limit=FILE_BYTES)
    except ValueError as error:
        raise WeightsError(str(error)) from None


def _spaces_of(
    config: Config, task: SceneTask | None
) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """What the policy sees, and what it does."""
    if task is not None:
        env = evaluation_env(task)
        return env.observation_space, env.action_space

    seen = observation_of(config.algorithm)
    frame = split_of(str(config.env.get("split"))).frame

    packing = Packing(seen, 2 * Task.patch_radius + 1, _IRS_OF_MANY_SCENES, frame)

    return packing.space, spaces.Discrete(len(MOVES))


def actions_of(space: Any) -> int:
    """How many actions there are in a discrete space, or numbers in one of a box."""
    return int(space.n if isinstance(space, spaces.Discrete) else spaces.flatdim(space))


def _rebuild(
    config: Config,
    space: spaces.Space[Any],
    actions: spaces.Space[Any],
    weights: Mapping[str, NDArray[Any]],
) -> Any:
    """The policy of Stable-Baselines3 with these weights, which must be all that act."""
    import torch

    try:
        agent = TypeAdapter(config_class(config.algorithm)).validate_python(config.agent)
    except ValidationError as error:
        raise WeightsError(
            f"its settings are wrong: {error.errors(include_url=False)[0]['msg']}"
        ) from None

    if _least(agent, space, actions_of(actions)) > sum(
        each.size for each in weights.values()
    ):  # before networks are made that fill memory
        raise WeightsError("it does not fit its configuration, whose networks are larger")

    make = policy_class(agent, space)
    policy = make(space, actions, lambda _: 0.0, **policy_kwargs(agent))
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
