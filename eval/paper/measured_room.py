"""`Receiver`: what a measured room is to a robot that keeps a link with one of its receivers, and
how PPO does there.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import floor
from pathlib import Path
from typing import Any

import numpy as np
import torch

from agents.rollout.episode import EpisodeResult, arguments_of, evaluation_env, roll_out
from agents.single.model import build_model
from agents.single.ppo import PpoConfig
from agents.vec_env import IrsNavVecEnv
from irs_gym import (
    Front,
    RadioMap,
    TradeOff,
    cost_map,
    from_rssi_histograms,
    pareto_front,
    shortest_path,
    trade_off,
)
from irs_gym import Path as Route
from irs_gym.files import read_file
from irs_gym.grid import Cell
from irs_gym.mdp.cost import CostKind
from irs_gym.mdp.task import Task
from irs_gym.radio.rssi import rssi_receivers

LEVEL_DBM = -75.0  # target of the violations and threshold of the outages
COSTS: tuple[CostKind, ...] = ("violation", "outage")
RANDOM_START = 0.7  # of PPO's episodes, as in all runs of one scene


@dataclass(frozen=True, eq=False)
class Receiver:
    """A receiver with its map, and the way across the room: from the walkable cell nearest to the
    lower left corner to the one nearest to the upper right.
    """

    name: str
    place: tuple[float, float] | None
    """Where it hangs, in metres; None where the folder does not say it."""
    radio_map: RadioMap

    @cached_property
    def start(self) -> Cell:
        """Nearest to the lower left corner."""
        return _nearest(self.radio_map, self.radio_map.grid.origin)

    @cached_property
    def goal(self) -> Cell:
        """Nearest to the upper right corner."""
        return _nearest(self.radio_map, self.radio_map.grid.upper)

    @cached_property
    def trade_off(self) -> TradeOff:
        """Shortest distance for every target of the mean power."""
        return trade_off(self.radio_map.gain_db, self.start, self.goal, self._cell_size)

    @property
    def highest_target(self) -> float:
        """Highest feasible target, rounded down to 0.01 dBm."""
        return floor(float(self.trade_off.targets_db[-1]) * 100) / 100

    @cached_property
    def path(self) -> Route:
        """A shortest path at that target."""
        feasible = self.radio_map.feasible(self.highest_target)
        path = shortest_path(feasible, self.start, self.goal, self._cell_size)
        if path is None:
            raise ValueError(f"receiver {self.name}: no way leads from {self.start} to {self.goal}")

        return path

    @cached_property
    def fronts(self) -> dict[CostKind, Front]:
        """Pareto fronts of cost and distance, for `COSTS` at `LEVEL_DBM`."""
        return {
            kind: pareto_front(
                cost_map(self.radio_map, LEVEL_DBM, kind), self.start, self.goal, self._cell_size
            )
            for kind in COSTS
        }

    @property
    def task(self) -> Task:
        """To cross the room at the highest feasible target."""
        return Task(
            radio_map=self.radio_map,
            start=self.start,
            goal=self.goal,
            target_db=self.highest_target,
        )

    @property
    def _cell_size(self) -> float:
        return self.radio_map.grid.cell_size


def read_room(folder: Path) -> list[Receiver]:
    """All receivers of a folder, in order of their names.

    Raises
    ------
    OSError
        Where a file cannot be read.
    ValueError
        Where one is damaged; see `irs_gym.from_rssi_histograms`.
    """
    places = _places(folder)
    return [
        Receiver(name, places.get(name), from_rssi_histograms(folder, name))
        for name in rssi_receivers(folder)
    ]


def _places(folder: Path) -> dict[str, tuple[float, float]]:
    """Where receivers hang, by their names, as ``cnf/*.dev`` tells it; empty without that."""
    places: dict[str, tuple[float, float]] = {}

    for path in sorted(folder.glob("cnf/*.dev")):
        for line in read_file(path).decode("utf-8", "replace").splitlines():
            kind, _, devices = line.partition(":")
            if kind == "Dongles":
                try:
                    said = json.loads(devices)
                    places |= {
                        name: (float(at[0][0]), float(at[0][1])) for name, at in said.items()
                    }
                except (AttributeError, IndexError, KeyError, RecursionError, TypeError) as error:
                    raise ValueError(f"{str(path)!r} tells no places: {error}") from None

    return places


def _nearest(radio_map: RadioMap, corner: tuple[float, float]) -> Cell:
    """The walkable cell nearest to a corner."""
    away = np.linalg.norm(radio_map.grid.centres() - corner, axis=-1)  # (X, Y)
    return radio_map.grid.cell_at(int(np.argmin(np.where(radio_map.free, away, np.inf))))


def longest_ways(receivers: Sequence[Receiver], count: int) -> list[Receiver]:
    """Those whose shortest path at their highest feasible target is longest."""
    return sorted(receivers, key=lambda each: -each.path.distance)[:count]


def play_ppo(receiver: Receiver, steps: int, seed: int) -> EpisodeResult:
    """One episode of PPO after so many steps of training with its usual settings."""
    config = replace(PpoConfig(), total_timesteps=steps)
    torch.set_num_threads(1)
    learning = replace(receiver.task, random_start=RANDOM_START)
    model: Any = build_model(config, IrsNavVecEnv(config.n_envs, **arguments_of(learning)), seed)
    model.learn(steps)
    model.get_env().close()

    return roll_out(model, evaluation_env(receiver.task))
