"""`Evaluation`: tests the agent during training, keeps its best state, and says when to stop; what
else is done on the way.
"""

import signal
import time
from typing import Any

import gymnasium
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from agents.rollout.episode import EpisodeResult, roll_out
from agents.runs.manifest import Status
from agents.runs.run_folder import Run

_STATE = ("rows", "best", "latest", "held", "_last")


class Evaluation(BaseCallback):
    """Plays the greedy policy from the fixed start at the beginning of rollouts, `every` steps or
    more apart.

    The best state is that of the shortest successful path, the first of equals. The oracle's
    distance decides on stopping alone. An interrupted training ends at the beginning of a rollout.
    """

    def __init__(
        self, run: Run, env: gymnasium.Env[Any, Any], every: int, hold: int | None
    ) -> None:
        super().__init__()
        self.run = run
        self.env = env
        self.every = every
        self.hold = hold
        self.rows: list[dict[str, Any]] = []
        self.best: EpisodeResult | None = None
        self.latest: EpisodeResult | None = None
        self.held = 0
        self.is_interrupted = False
        self.signal = int(signal.SIGINT)  # what has interrupted it
        self._is_over = False
        self._last = 0  # steps at the latest test
        self._seconds = 0.0  # of training before this process

    def interrupt(self, number: int) -> None:
        """End the training after the step in hand, because of that signal."""
        self.is_interrupted = True
        self.signal = number

    @property
    def is_at_optimum(self) -> bool:
        """Whether the oracle's distance has been reached and held."""
        return self.hold is not None and self.held >= self.hold

    @property
    def status(self) -> Status:
        """How the training has ended."""
        if self.is_at_optimum:
            return "at_optimum"
        return "interrupted" if self.is_interrupted else "finished"

    @property
    def summary(self) -> str:
        """The result in one line."""
        status = self.status.replace("_", " ")
        seen = f"{status} after {self.num_timesteps:,} steps, {self.rows[-1]['seconds']:.0f} s"
        if self.best is None or self.best.ratio is None:
            return f"{seen}; no test reached the goal"

        return (
            f"{seen}; best path {self.best.distance:.3f} m, "
            f"{self.best.ratio:.3f} times the oracle's"
        )

    @property
    def seconds(self) -> float:
        """Training time so far, without what was lost when a process was killed."""
        return self._seconds + time.monotonic() - self._started

    @property
    def state(self) -> dict[str, Any]:
        """What the rest of the run depends on."""
        return {**{name: vars(self)[name] for name in _STATE}, "_seconds": self.seconds}

    @state.setter
    def state(self, state: dict[str, Any]) -> None:
        vars(self).update(state)

    def _on_training_start(self) -> None:
        self._started = time.monotonic()

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._last >= self.every:
            self._test()

        self._is_over = self.is_at_optimum or self.is_interrupted

    def _on_step(self) -> bool:
        return not self._is_over

    def _on_training_end(self) -> None:
        if self.num_timesteps > self._last and not self.is_at_optimum:
            self._test()

    def _test(self) -> None:
        self.latest = episode = roll_out(self.model, self.env)
        self.held = self.held + 1 if episode.is_optimal else 0
        row = {
            "is_success": int(episode.is_success),
            "distance": episode.distance,
            "ratio": episode.ratio,
            "spl": episode.spl,
            "refused": episode.refused,
            "total_reward": episode.total_reward,
        }
        self._note(row, ("is_success", "ratio", "spl"), is_best=self._is_better(episode))

    def _note(self, row: dict[str, Any], logged: tuple[str, ...], *, is_best: bool) -> None:
        """Put down the result of a test, and keep the best model."""
        self._last = self.num_timesteps
        self.rows.append({"steps": self.num_timesteps, "seconds": round(self.seconds, 3), **row})

        for name in logged:
            self.logger.record(f"eval/{name}", row[name])

        self.logger.dump(self.num_timesteps)
        self.run.write_curve(self.rows)
        if is_best:
            self.best = self.latest
            self.save("best")

    def save(self, name: str) -> None:
        """Write the model, with the result of its latest test, to the run folder."""
        assert self.latest is not None
        result = {"is_success": self.latest.is_success, "ratio": self.latest.ratio}
        self.run.save_model(name, self.model, self.num_timesteps, **result)

    def _is_better(self, episode: EpisodeResult) -> bool:
        if self.best is None or not self.best.is_success:
            return True
        return episode.is_success and episode.distance < self.best.distance


class _Scheduled(BaseCallback):
    """Changes something of PPO over the schedule, linearly unless `_value` says otherwise: before a
    rollout, so that its actions and the update are of the same.
    """

    def __init__(self, first: float, last: float) -> None:
        super().__init__()
        self.first = first
        self.last = last

    def _on_rollout_start(self) -> None:
        self._assign(self._value(self.model._current_progress_remaining))

    def _on_step(self) -> bool:
        return True

    def _value(self, left: float) -> float:
        """What holds when a share of the schedule is left."""
        return self.last + (self.first - self.last) * left

    def _assign(self, value: float) -> None:
        raise NotImplementedError


class FallingEntropy(_Scheduled):
    """Lowers the weight of PPO's entropy bonus."""

    def _assign(self, value: float) -> None:
        self.model.ent_coef = value  # type: ignore[attr-defined]


class FallingSpread(_Scheduled):
    """Lowers the logarithm of the standard deviation of PPO's actions."""

    def _assign(self, value: float) -> None:
        policy: Any = self.model.policy
        policy.log_std.data.fill_(value)


class LaterStarts(_Scheduled):
    """Draws starts with other probabilities in the two halves of the schedule."""

    def _value(self, left: float) -> float:
        return self.last if left <= 0.5 else self.first

    def _assign(self, value: float) -> None:
        envs: Any = self.training_env
        envs.envs.random_start = value


class Progress(BaseCallback):
    """A progress bar in steps, however many are taken at a time."""

    def _on_training_start(self) -> None:
        self._bar = tqdm(
            total=self.locals["total_timesteps"], initial=self.num_timesteps, unit=" steps"
        )

    def _on_step(self) -> bool:
        self._bar.update(self.num_timesteps - self._bar.n)
        return True

    def _on_training_end(self) -> None:
        self._bar.close()
