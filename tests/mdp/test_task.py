"""Facts of tasks: what a task leaves open its scene says, and what it says itself goes before."""

import inspect
from dataclasses import fields, replace
from typing import get_type_hints

import numpy as np
import pytest

from agents.rollout.episode import arguments_of
from agents.runs.problem import problem_of
from irs_gym.datasets.random_task import RandomTask, RandomTaskArguments
from irs_gym.envs.nav import IrsNavEnv
from irs_gym.envs.random_nav import IrsNavRandomEnv
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from irs_gym.envs.vector_nav import IrsNavVectorEnv
from irs_gym.mdp.task import (
    ForeignMap,
    Rules,
    Task,
    TaskArguments,
    _build_world,
    build_world,
    resolved,
)
from irs_gym.radio import radio_map
from irs_gym.radio.radio_map import RadioMap, RadioModel, build_phase_shifts, build_radio_map
from irs_gym.radio.scene import load_scene

PAPER = load_scene("paper")
OWN = PAPER.model_copy(update={"target_db": -63.0, "phase_bits": 1})
FLOOR = {"radio_map": RadioMap.from_array(np.zeros((5, 4)), 1.0), "start": (0, 0), "goal": (4, 2)}


def test_target_and_resolution_are_the_scenes_where_the_task_says_none():
    world = build_world(Task(scene=OWN))
    assert (world.target_db, world.task.target_db, world.task.phase_bits) == (-63.0, -63.0, 1)
    assert build_world(Task()).target_db == -61.8
    assert build_world(Task()).task.phase_bits is None


def test_target_and_resolution_of_a_task_go_before_the_scenes():
    world = build_world(Task(scene=OWN, target_db=-64, phase_bits=2))
    assert (world.target_db, world.task.phase_bits) == (-64.0, 2)
    assert world.irs[0, 0, 1] == np.float32(1 - 2 / 4)


def test_a_scene_that_says_its_task_gives_the_world_of_a_task_that_does():
    own, said = build_world(Task(scene=OWN)), build_world(Task(target_db=-63.0, phase_bits=1))
    assert np.array_equal(own.radio_map.gain_db, said.radio_map.gain_db)
    assert np.array_equal(own.feasible, said.feasible)
    assert np.array_equal(own.irs, said.irs)


def test_tasks_that_resolve_to_the_same_share_a_world():
    assert build_world(Task(target_db=-61.8)) is build_world(Task())
    assert build_world(build_world(Task(scene=OWN)).task) is build_world(Task(scene=OWN))


def test_maps_and_phase_shifts_take_the_scenes_resolution():
    for build in (lambda *given: build_radio_map(*given).gain_db, build_phase_shifts):
        one_bit = build(OWN, 1.0)
        assert np.array_equal(one_bit, build(PAPER, 1.0, None, 1))
        assert not np.array_equal(one_bit, build(PAPER, 1.0))
        assert np.array_equal(build(OWN, 1.0, None, 3), build(PAPER, 1.0, None, 3))


def test_a_map_from_elsewhere_has_the_papers_target_where_none_is_given():
    assert build_world(Task(**FLOOR)).target_db == -61.8
    assert build_world(Task(**FLOOR, target_db=-50.0)).target_db == -50.0


def test_resolving_twice_changes_nothing():
    for task in (Task(), Task(scene=OWN, target_db=-64.0), Task(**FLOOR)):
        assert resolved(resolved(task).arguments) == resolved(task)


def test_problems_are_equal_whether_the_task_or_the_scene_says_so():
    assert problem_of(Task(scene=OWN)) == problem_of(Task(target_db=-63.0, phase_bits=1))
    assert problem_of(Task(scene=OWN)).label == "-63.0 dB, 1 bit"
    mine = OWN.model_copy(update={"name": "mine"})
    assert problem_of(Task(scene=mine)) == replace(
        problem_of(Task(scene=OWN)), scene=problem_of(Task(scene=mine)).scene
    )
    assert problem_of(Task(scene=mine, target_db=-64.0)) != problem_of(Task(scene=mine))


def test_the_name_of_a_problem_of_ones_own_is_what_it_was_before_scenes_said_their_task():
    mine = PAPER.model_copy(update={"name": "mine"})
    assert problem_of(Task(scene=mine)).scene == "mine-cdca7bf9"


@pytest.mark.parametrize("target_db", [float("nan"), float("inf"), "low"])
def test_a_target_that_is_no_number_is_refused(target_db):
    with pytest.raises(ValueError, match=r"target_db=.* must be a finite number"):
        Task(target_db=target_db)


def test_each_field_of_a_task_is_the_radios_or_the_robots():
    radio = {each.name for each in fields(RadioModel)}
    rules = {each.name for each in fields(Rules)}
    ends = {"target_db", "start", "goal", "radio_map"}
    assert radio.isdisjoint(rules)
    assert radio | rules | ends == {each.name for each in fields(Task)}
    assert rules - {"irs_phases"} == rules & {each.name for each in fields(RandomTask)}


def test_a_resolved_task_holds_a_model_of_the_radio_or_a_map_from_elsewhere():
    assert resolved(Task(scene=OWN, cell_size=1.0)).radio == RadioModel(
        scene=OWN,
        cell_size=1.0,
        irs_elements=None,
        phase_bits=1,
        quantiser="nearest",
        array_model="far_field",
    )
    assert resolved(Task(**FLOOR)).radio == ForeignMap(FLOOR["radio_map"], (0, 0), (4, 2))


@pytest.mark.parametrize("task", [Task(), Task(scene=OWN, phase_bits=2), Task(**FLOOR)])
def test_the_task_of_an_environment_makes_it_again(task):
    made = IrsNavEnv(**arguments_of(task))
    assert IrsNavEnv(**arguments_of(made.task)).world is made.world


TWO = PAPER.model_copy(
    update={
        "access_points": (
            PAPER.access_points[0],
            PAPER.access_points[0].model_copy(update={"position": (15.0, 18.0, 2.0)}),
        )
    }
)


@pytest.mark.parametrize("scene", [PAPER, TWO], ids=["paper", "two access points"])
@pytest.mark.parametrize("bits", [None, 2])
@pytest.mark.parametrize("irs_phases", [True, False])
def test_building_a_world_computes_the_channel_of_each_access_point_once(
    monkeypatch, scene, bits, irs_phases
):
    points = []

    def counted(scene, access_point, positions):
        points.append(access_point)
        return channel(scene, access_point, positions)

    channel = radio_map.channel
    monkeypatch.setattr(radio_map, "channel", counted)
    _build_world.cache_clear()
    world = build_world(Task(scene=scene, phase_bits=bits, irs_phases=irs_phases))
    assert points == [*scene.access_points]

    monkeypatch.undo()
    alone = build_radio_map(scene, phase_bits=bits).gain_db
    assert np.array_equal(world.radio_map.gain_db, alone)
    if irs_phases:
        shifts = build_phase_shifts(scene, phase_bits=bits)
        told = np.clip(shifts / np.float32(np.pi) - 1, -1, 1)
        assert np.array_equal(world.irs[..., 3:], told)


@pytest.mark.parametrize(
    ("env", "task"),
    [
        (IrsNavEnv, Task),
        (IrsNavVectorEnv, Task),
        (IrsNavRandomEnv, RandomTask),
        (IrsNavRandomVectorEnv, RandomTask),
    ],
)
def test_signatures_show_every_field_of_the_task_with_its_type_and_default(env, task):
    shown = inspect.signature(env).parameters
    asked = inspect.signature(task).parameters
    own = [name for name in shown if name not in asked]
    assert own[-2:] == ["render_mode", "infos"]
    assert [shown[name] for name in asked] == [*asked.values()]
    assert all(each.default is not inspect.Parameter.empty for each in shown.values())
    assert all(each.annotation is not inspect.Parameter.empty for each in shown.values())
    assert inspect.Parameter.VAR_KEYWORD not in {each.kind for each in shown.values()}


@pytest.mark.parametrize(
    ("arguments", "task"), [(TaskArguments, Task), (RandomTaskArguments, RandomTask)]
)
def test_type_checkers_know_the_fields_of_the_task(arguments, task):
    assert list(get_type_hints(arguments).items()) == list(get_type_hints(task).items())
