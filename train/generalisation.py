"""`Generalisation`: tests a generalist on scenes that it does not learn on, and keeps its best
state.
"""

from agents.rollout.scene_set import SceneSetResults, play_scene_set
from agents.runs.run_folder import Run
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.mdp.task import Observation
from train.evaluation import Evaluation


class Generalisation(Evaluation):
    """Plays the greedy policy from the start of each scene of a pool; the best state has the
    greatest mean SPL.
    """

    latest: SceneSetResults | None  # type: ignore[assignment]
    best: SceneSetResults | None  # type: ignore[assignment]

    def __init__(self, run: Run, pool: SceneSet, every: int, observation: Observation) -> None:
        super().__init__(run, None, every, None)  # type: ignore[arg-type]  # plays in no environment
        self.pool = pool
        self.observation = observation

    @property
    def summary(self) -> str:
        """The result in one line."""
        assert self.best is not None
        status = self.status.replace("_", " ")
        seen = f"{status} after {self.num_timesteps:,} steps, {self.rows[-1]['seconds']:.0f} s"
        success = self.best.is_success.mean()
        spl = self.best.spl.mean()

        return (
            f"{seen}; success {success:.3f}, SPL {spl:.4f} "
            f"on {len(self.pool)} scenes that it did not learn on"
        )

    def _test(self) -> None:
        self.latest = episodes = play_scene_set(self.model.policy, self.pool, self.observation)
        row = {
            "success": episodes.is_success.mean(),
            "spl": episodes.spl.mean(),
            "ratio": episodes.ratio,
        }
        is_best = (
            self.best is None or row["spl"] >= self.best.spl.mean()
        )  # of equals, the one that learned longest
        self._note(row, ("success", "spl"), is_best=is_best)

    def save(self, name: str) -> None:
        """Write the model, with the result of its latest test, to the run folder."""
        assert self.latest is not None
        result = {
            "success": float(self.latest.is_success.mean()),
            "spl": float(self.latest.spl.mean()),
        }
        self.run.save_model(name, self.model, self.num_timesteps, **result)
