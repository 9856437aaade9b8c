"""`LoadedPolicy`: a policy that a user names, and the environment that it is shown in."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import gymnasium

from agents.policies.continuous_heuristics import CONTINUOUS_REFERENCES
from agents.policies.explorer_policy import Explorer
from agents.policies.heuristics import REFERENCE_POLICIES
from agents.policies.model_file import read_network
from agents.policies.policy import Policy
from agents.registry import ALGORITHMS, drivers, generalists, observation_of, specialists
from agents.rollout.episode import SceneTask, arguments_of, env_id_of
from agents.runs.pretrained import load_pretrained
from agents.runs.run_folder import Run
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.datasets.generator import CELL_SIZE
from irs_gym.datasets.scene_set import frame_of, scene_set_of
from irs_gym.files import read_file
from irs_gym.mdp.task import Task
from irs_gym.radio.scene import load_scene


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a policy plays, if not where it learned.

    The first four are for one scene, the next two for the generated ones. What learned in one task
    plays there.
    """

    scene: str | None = None
    """A scene of the package, or the path of a scene file; the paper's by default."""
    target_db: float | None = None
    """Target in dB; as the scene says by default."""
    phase_bits: int | None = None
    """Resolution of the phase shifters in bits; as the scene says by default."""
    irs_elements: int | None = None
    """Elements on each panel; as the scene says by default."""
    split: str | None = None
    """A set of generated scenes, see `irs_gym.datasets.splits.SPLITS`; of what learned on many
    scenes "test" by default.
    """
    scene_id: int | None = None
    """Number of the scene in it; the first by default."""
    continuous: bool = False
    """Whether a reference policy goes anywhere on the floor, and not from cell to cell."""

    @property
    def given(self) -> dict[str, Any]:
        """What is set of the scene."""
        return {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if each.name != "continuous" and getattr(self, each.name) is not None
        }

    @property
    def of_one_scene(self) -> dict[str, Any]:
        """What is set, as arguments of `irs_gym.mdp.task.Task`; raises ``ValueError`` where a
        generated scene is too.
        """
        generated = [name for name in ("split", "scene_id") if name in self.given]
        if generated:
            others = ", ".join(name for name in self.given if name not in generated)
            why = f"along with {others}" if others else "here: this policy learned in one scene"
            raise ValueError(f"{' and '.join(generated)} cannot be given {why}")

        return self.given

    def scenes(self) -> tuple[dict[str, Any], int]:
        """Arguments of an environment of many scenes, and the number of the scene.

        Raises
        ------
        OSError
            Where the scene's file cannot be read.
        ValueError
            Where one scene and a generated one are asked for at once, or there is no such scene.
        """
        one = [name for name in self.given if name not in ("split", "scene_id")]
        if not one:
            number = self.scene_id or 0
            if number < 0:
                raise ValueError(f"scene_id={number} must be 0 or more")
            return {"split": self.split or "test", "num_scenes": number + 1}, number

        own = self.of_one_scene
        scene = load_scene(own.pop("scene", "paper"))
        elements = own.pop("irs_elements", None)
        scene = scene if elements is None else scene.with_irs_elements(elements)

        changed = type(scene).model_validate({**scene.model_dump(), **own})

        # in the frame in which the scene is scored
        frame = frame_of(changed.grid(CELL_SIZE).shape)
        return {"scenes": scene_set_of([changed], frame=frame)}, 0


AT_HOME = Place()


@dataclass(frozen=True)
class LoadedPolicy:
    """A policy, its environment, and the options of the environment's reset."""

    policy: Policy
    env: gymnasium.Env[Any, Any]
    options: dict[str, Any] | None = None


def load_policy(
    name: str, place: Place, render_mode: str | None, *, model: str = "best", seed: int = 0
) -> LoadedPolicy:
    """The policy of that name, and an environment for it that renders in a mode.

    Parameters
    ----------
    name
        An algorithm with a pretrained model, a run folder, the file of a network, or a reference
        policy.
    place
        Where it plays.
    model
        Which state of a run's agent plays.
    seed
        Seed of the random policies.

    Raises
    ------
    OSError
        Where a file cannot be read.
    ValueError
        Where there is no such policy, or it does not play there.
    """
    if place.continuous:
        return _continuous_reference(name, place, render_mode, seed)

    if Path(name).suffix == ".npz":
        policy = read_network(read_file(Path(name)))
        observation = "flat" if isinstance(policy, Explorer) else "map"
        return _on_scenes(policy, observation, place, render_mode)

    # a folder that happens to be called "ppo" is no run unless it holds one
    is_run = Path(name, "manifest.json").exists() or name not in ALGORITHMS
    if Path(name).exists() and is_run:
        return _of_run(Run.open(name), place, render_mode, model)

    if name in specialists():
        pretrained: Any = load_pretrained(name, **place.of_one_scene)
        return LoadedPolicy(pretrained, pretrained.make_env(render_mode))

    if name in drivers():
        raise ValueError(f"there is no pretrained {name}: name a run folder")
    if name in generalists():
        return _generalist(load_pretrained(name).policy, name, place, render_mode)
    if name in REFERENCE_POLICIES:
        return _reference(lambda env: REFERENCE_POLICIES[name](env, seed), place, render_mode)

    if name in CONTINUOUS_REFERENCES:
        raise ValueError(f"{name!r} goes anywhere on the floor: continuous must be given too")

    known = ", ".join([*ALGORITHMS, *REFERENCE_POLICIES])
    raise ValueError(f"{name!r} is neither a run folder nor one of {known}")


def _of_run(run: Run, place: Place, render_mode: str | None, model: str) -> LoadedPolicy:
    if run.is_generalist:
        return _generalist(run.load_model(model), run.config.algorithm, place, render_mode)

    if place.given:
        said = ", ".join(place.given)
        raise ValueError(
            f"{said} cannot be given along with a run: its agent plays where it was trained"
        )

    return LoadedPolicy(run.load_model(model), _in_task(run.task, render_mode))


def _generalist(policy: Any, algorithm: str, place: Place, render_mode: str | None) -> LoadedPolicy:
    return _on_scenes(policy, observation_of(algorithm), place, render_mode)


def _on_scenes(
    policy: Any, observation: str, place: Place, render_mode: str | None
) -> LoadedPolicy:
    arguments, number = place.scenes()
    env = gymnasium.make(
        "irs_gym:IrsNavRandom-v0", render_mode=render_mode, observation=observation, **arguments
    )
    if isinstance(policy, Explorer):  # its memory is as large as the largest map
        inner: Any = env.unwrapped
        policy = replace(policy, shape=inner.worlds.pool.shape)

    return LoadedPolicy(policy, env, {"scene_id": number})


def _reference(
    make: Callable[[gymnasium.Env[Any, Any]], Policy], place: Place, render_mode: str | None
) -> LoadedPolicy:
    if place.split is None and place.scene_id is None:
        env = _in_task(Task(**place.given), render_mode)
        return LoadedPolicy(make(env), env)

    # a reference policy is made for its environment, which comes first
    blank = _on_scenes(None, "flat", place, render_mode)
    return replace(blank, policy=make(blank.env))


def _continuous_reference(
    name: str, place: Place, render_mode: str | None, seed: int
) -> LoadedPolicy:
    if name not in CONTINUOUS_REFERENCES:
        known = ", ".join(CONTINUOUS_REFERENCES)
        raise ValueError(f"continuous is for {known}, and cannot be given with {name!r}")

    if place.split is None and place.scene_id is None:
        env = _in_task(ContinuousTask(**place.given), render_mode)
        options = None
    else:
        arguments, number = place.scenes()
        env = gymnasium.make("irs_gym:IrsNavContinuous-v0", render_mode=render_mode, **arguments)
        options = {"scene_id": number}

    return LoadedPolicy(CONTINUOUS_REFERENCES[name](env, seed), env, options)


def _in_task(task: SceneTask, render_mode: str | None) -> gymnasium.Env[Any, Any]:
    arguments = arguments_of(replace(task, random_start=False))
    return gymnasium.make(env_id_of(task), render_mode=render_mode, **arguments)
