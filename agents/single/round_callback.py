"""`RoundCallback`: what the callbacks of a training in rounds see of the PPO of one of them."""

from typing import Any

from stable_baselines3.common.callbacks import BaseCallback


class RoundCallback(BaseCallback):
    """Hands the beginnings of rollouts and the steps on to the callbacks of the whole training, and
    ends the round where its tests have held one value.

    Parameters
    ----------
    whole
        `agents.single.ppo_lagrangian.PpoLagrangian`.
    callback
        Of the whole training.
    before
        Steps of the rounds before.
    """

    def __init__(self, whole: Any, callback: BaseCallback, before: int) -> None:
        super().__init__()
        self.whole = whole
        self.callback = callback
        self.before = before
        self.is_stopped = False  # from outside
        self._is_over = False

    def _on_rollout_start(self) -> None:
        self.whole.num_timesteps = self.before + self.model.num_timesteps
        self._is_over = self.whole.is_round_over()
        self.callback.on_rollout_start()

    def _on_step(self) -> bool:
        self.whole.num_timesteps = self.before + self.model.num_timesteps
        self.is_stopped = not self.callback.on_step()

        return not (self.is_stopped or self._is_over)
