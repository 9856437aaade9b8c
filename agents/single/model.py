"""`build_model`: a model that learns in environments, untrained, from its settings; and how the
policies of Stable-Baselines3 are made.
"""

from __future__ import annotations

from dataclasses import asdict
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from agents.registry import ALGORITHMS, learner_class, named
from agents.single.config import Sb3Config

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

# The settings that are not handed on to the model of Stable-Baselines3 under their own names.
_NOT_THE_MODELS = (
    "total_timesteps",
    "n_envs",
    "learning_rate",
    "final_learning_rate",
    "final_ent_coef",
    "final_log_std",
    "final_random_start",
    "signs",
    "mask_head",
)


def build_model(config: Any, env: VecEnv, seed: int) -> Any:
    """The model of any algorithm that learns in environments, of which ``env`` should hold as many
    as the settings say.
    """
    learner = learner_class(config.algorithm)
    if not ALGORITHMS[config.algorithm].is_sb3:
        return learner.build(config, env, seed)

    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.utils import LinearSchedule

    elsewhere = (*_NOT_THE_MODELS, *config.policy_settings, *config.env_settings)
    own = {name: value for name, value in asdict(config).items() if name not in elsewhere}

    if "action_noise" in own:
        spread = np.full(env.action_space.shape or (), own["action_noise"])
        own["action_noise"] = NormalActionNoise(np.zeros_like(spread), spread)

    return learner(
        policy_class(config, env.observation_space),
        env,
        learning_rate=LinearSchedule(config.learning_rate, config.final_learning_rate, 1.0),
        policy_kwargs=policy_kwargs(config),
        seed=seed,
        device="cpu",  # faster than a GPU for networks this small
        **own,
    )


def policy_class(config: Sb3Config, space: spaces.Space[Any]) -> Any:
    """The class of the policy for these observations: the algorithm's own, or one of SB3's."""
    row = ALGORITHMS[config.algorithm]
    policy = row.masked_policy if getattr(config, "mask_head", False) else row.policy
    if policy is not None:
        return named(policy)

    return named(row.mixes or row.learner).policy_aliases[policy_name(config, space)]


def policy_name(config: Sb3Config, space: spaces.Space[Any]) -> str:
    """SB3's name of the policy for these observations."""
    if _is_recurrent(config):
        return "MlpLstmPolicy"
    return "MultiInputPolicy" if isinstance(space, spaces.Dict) else "MlpPolicy"


def policy_kwargs(config: Sb3Config) -> dict[str, Any]:
    """What is handed on to the networks, with what reads the observation in front of them."""
    given = {name: getattr(config, name) for name in config.policy_settings}
    extractor = _extractor(config)
    front = {} if extractor is None else {"features_extractor_class": extractor}

    return {**given, "net_arch": list(config.net_arch), **front}


def first_layer(config: Sb3Config, space: spaces.Space[Any]) -> int:
    """Numbers, at the least, that the first layer reads of an observation."""
    if _is_recurrent(config):
        return int(config.lstm_hidden_size)  # type: ignore[attr-defined]  # which is how it is told

    # An extractor that makes features of any observation has their number as an argument; others
    # add to what the observation holds.
    extractor = _extractor(config)
    features = None if extractor is None else signature(extractor).parameters.get("features_dim")

    return spaces.flatdim(space) if features is None else int(features.default)


def _is_recurrent(config: Sb3Config) -> bool:
    return "lstm_hidden_size" in config.policy_settings


def _extractor(config: Sb3Config) -> Any:
    own = ALGORITHMS[config.algorithm].network
    network = "agents.networks.sign_extractor:SignExtractor" if config.signs else own

    return None if network is None else named(network)
