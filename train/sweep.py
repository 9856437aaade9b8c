"""`python -m train sweep FILE`: the runs of a sweep file, in parallel on Ray; started again, it
goes on.
"""

import os
import re
import signal
import sys
import time
from collections import Counter, deque
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import ray
from rich.console import Console
from rich.live import Live
from rich.table import Table
from tyro.conf import Positional

from agents.registry import generalists
from agents.rollout.episode import TOLERANCE
from agents.runs.interruption import Interruption, noticed
from agents.runs.provenance import ROOT
from agents.runs.run_folder import LockedError, Run
from irs_gym.files import write_file
from train import resume
from train.config import GeneralistConfig, TrainConfig, record_of
from train.plan import Plan
from train.run import train_locked


def main(
    file: Positional[Path], jobs: int | None = None, retries: int = 1, trust: bool = False
) -> int:
    """Train every algorithm in every setting with every seed that a sweep file names.

    On this machine, or on the Ray cluster at RAY_ADDRESS, whose machines must all see this
    checkout, the runs and, where IRS_GYM_KEY names one, a key file under the same paths. Started
    again, it leaves runs that have ended as they are, goes on with those that were interrupted, and
    tries those that have failed once more. Runs that another process is training are left to it.
    Ctrl-C, SIGTERM and SIGHUP let the runs in hand write a checkpoint and end; a second time, all
    ends at once.

    Parameters
    ----------
    file
        Sweep file; there are some in train/sweeps/.
    jobs
        Runs at a time; None for one on each processor.
    retries
        How often a run that fails is tried again before it is kept as failed.
    trust
        Whether to go on with runs that you have not made on this machine. That runs code which is
        stored in their checkpoints, with all your rights: only say so where you trust whoever made
        them.
    """
    try:
        if retries < 0 or (jobs is not None and jobs < 1):
            raise ValueError(
                f"jobs={jobs} must be 1 or more, and retries={retries} must not be negative"
            )

        plan = Plan.load(file)
        plan.check(trust=trust)
    except (OSError, ValueError) as error:
        print(f"python -m train sweep: {error}", file=sys.stderr)
        return 2

    sweep = Sweep(plan, retries, trust)
    try:
        sweep.run(jobs)
    except KeyboardInterrupt as error:
        print("python -m train sweep: interrupted; the same command goes on", file=sys.stderr)
        return 128 + getattr(error, "number", signal.SIGINT)

    return 1 if "failed" in sweep.states.values() else 0


_DONE = ("ended", "exact")


class Sweep:
    """The runs of a plan and how they stand: waiting, running, ended, exact, failed, or elsewhere:
    another's.
    """

    def __init__(self, plan: Plan, retries: int, trust: bool = False) -> None:
        self.plan = plan
        self.retries = retries
        self.trust = trust
        self.states: dict[Path, str] = {}
        self.waiting: deque[TrainConfig | GeneralistConfig] = deque()
        self.running: dict[Any, TrainConfig | GeneralistConfig] = {}  # by Ray's name of the task
        self.failures: Counter[Path] = Counter()
        self.signal: int | None = None  # that has interrupted it
        self.began = time.monotonic()
        self.trained = 0

        for config in plan.configs():
            folder = _folder(config)
            self.states[folder] = _state(folder)
            if self.states[folder] in ("waiting", "failed"):
                self.waiting.append(config)

    def run(self, jobs: int | None) -> None:
        """Train what is waiting, so many runs at a time; shows a table that follows it."""
        console = Console()
        if not self.waiting:
            console.print(self.table())
            return

        slots = _start_ray(None if jobs is None else min(jobs, len(self.waiting)))
        try:
            # Within noticed() alone, since Ray has begun to handle SIGTERM itself.
            with (
                noticed(self._interrupt),
                Live(get_renderable=self.table, console=console, refresh_per_second=1) as live,
            ):
                self._run(slots, live.console)
        finally:
            ray.shutdown()

        if self.signal is not None:
            raise Interruption(self.signal)

    def _run(self, slots: int, console: Console) -> None:
        is_told = False
        while self.running or (self.waiting and self.signal is None):
            while self.waiting and self.signal is None and len(self.running) < slots:
                self._begin(self.waiting.popleft())

            if self.signal is not None and not is_told:
                is_told = True
                for task in self.running:
                    ray.cancel(task)  # a Ctrl-C for the worker

            ended, _ = ray.wait(list(self.running), timeout=1.0)
            for task in ended:
                console.print(self._end(task), highlight=False, soft_wrap=True)

    def _interrupt(self, number: int) -> None:
        self.signal = number

    def table(self) -> Table:
        """How many runs of each algorithm in each setting have ended, and found the optimum."""
        algorithms = list(dict.fromkeys(algorithm for _, algorithm in self.plan.cells()))
        cells = set(self.plan.cells())
        rows = Table(
            "setting", *(each.replace("_", " ") for each in algorithms), caption=self._caption()
        )

        for name in self.plan.settings:
            rows.add_row(
                name,
                *(self._cell(name, each) if (name, each) in cells else "" for each in algorithms),
            )

        return rows

    def _cell(self, setting: str, algorithm: str) -> str:
        counts = Counter(
            self.states[self.plan.folder(setting, algorithm, n)] for n in range(self.plan.seeds)
        )
        said = [f"{counts['exact'] + counts['ended']}/{self.plan.seeds}"]
        said += [] if algorithm in generalists() else [f"{counts['exact']} exact"]
        return ", ".join(
            said
            + [
                f"{counts[state]} {state}"
                for state in ("running", "failed", "elsewhere")
                if counts[state]
            ]
        )

    def _caption(self) -> str:
        counts = Counter(self.states.values())
        passed = time.monotonic() - self.began
        said = f"{counts['exact'] + counts['ended']} of {len(self.states)} runs, "
        said += f"{counts['failed']} failed, {timedelta(seconds=round(passed))}"
        if not self.trained or not self.running:
            return said

        left = passed / self.trained * (len(self.waiting) + len(self.running) / 2)

        return f"{said}, about {timedelta(seconds=round(left))} left"

    def _begin(self, config: TrainConfig | GeneralistConfig) -> None:
        self.states[_folder(config)] = "running"
        self.running[_train.remote(replace(config, trust=self.trust))] = config

    def _end(self, task: Any) -> str:
        """Note how a run has ended; returns it as a line of text."""
        config = self.running.pop(task)
        folder = _folder(config)

        try:
            said = ray.get(task)
        except ray.exceptions.RayError as error:
            said, self.states[folder] = self._fail(config, error)
        else:
            self.trained += 1
            self.states[folder] = _state(folder)

        if self.states[folder] == "waiting" and self.signal is None:
            self.waiting.append(config)

        return f"{folder}: {said}"

    def _fail(self, config: TrainConfig | GeneralistConfig, error: Exception) -> tuple[str, str]:
        """What to say of a run that has failed, and how it stands."""
        folder = _folder(config)
        cause = getattr(error, "cause", error)
        if isinstance(cause, LockedError):
            return "another process is training it", "elsewhere"
        if self.signal is not None:
            return "interrupted", "waiting"

        reason = f"{type(cause).__name__}: {cause}"
        self.failures[folder] += 1
        if self.failures[folder] <= self.retries:
            return f"failed, and is tried again: {reason}", "waiting"

        try:
            return self._keep_failed(config, error, reason)
        except LockedError:
            return "failed, and another process is training it", "elsewhere"
        except (OSError, ValueError) as trouble:
            return f"failed: {reason}; which cannot be written down: {trouble}", "failed"

    def _keep_failed(
        self, config: TrainConfig | GeneralistConfig, error: Exception, reason: str
    ) -> tuple[str, str]:
        run = Run(_folder(config))
        with run.locked():
            if not run.folder.exists():
                run.begin(record_of(config))
            elif _state(run.folder) in _DONE:
                return "another process has trained it", _state(run.folder)

            traceback = re.sub(r"\x1b\[\d+m", "", str(error))  # which Ray colours
            write_file(run.folder / "traceback.txt", traceback.encode())
            run.update(status="failed", error=reason)

        return f"failed: {reason}; see {run.folder / 'traceback.txt'}", "failed"


@ray.remote(
    num_cpus=1, max_calls=1, max_retries=0
)  # a process for each run, so that none depends on another
def _train(config: TrainConfig | GeneralistConfig) -> str:
    """Train a run, or go on with it; begins anew where it cannot go on. Returns its result in a
    line.
    """
    run = Run(_folder(config))

    with run.locked():
        if run.folder.exists():
            if _state(run.folder) in _DONE:
                return "another process has trained it"

            try:
                resume.check(Run.open(run.folder), trust=config.trust)
                return train_locked(run, replace(config, resume=run.folder)).summary
            except resume.CannotResumeError as error:
                print(f"{error}: the run begins anew", file=sys.stderr)

        return train_locked(run, replace(config, overwrite=True)).summary


def _start_ray(jobs: int | None) -> int:
    """Start Ray on this machine, or join the cluster at RAY_ADDRESS; returns how many runs to train
    at a time.
    """
    address = os.environ.get("RAY_ADDRESS")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if address:
        shared = {"PYTHONPATH": str(ROOT)}
        if "IRS_GYM_KEY" in os.environ:
            shared["IRS_GYM_KEY"] = os.environ["IRS_GYM_KEY"]

        ray.init(address=address, runtime_env={"env_vars": shared}, **quiet)
    else:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        ray.init(
            address="local",
            num_cpus=jobs,
            include_dashboard=False,
            object_store_memory=10**8,
            **quiet,
        )

    return jobs or int(ray.cluster_resources()["CPU"])  # type: ignore[no-untyped-call]


def _state(folder: Path) -> str:
    if not folder.exists():
        return "waiting"

    manifest = Run.open(folder).manifest
    if manifest.status not in resume.ENDED:
        return "failed" if manifest.status == "failed" else "waiting"

    ratio = getattr(
        manifest.models.get("best"), "ratio", None
    )  # a generalist has none: nothing is exact everywhere

    return "exact" if ratio is not None and ratio <= 1.0 + TOLERANCE else "ended"


def _folder(config: TrainConfig | GeneralistConfig) -> Path:
    assert config.out is not None  # a plan names it
    return config.out
