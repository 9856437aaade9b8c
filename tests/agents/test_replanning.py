"""Facts of optimistic replanning: what it knows, and that nobody could plan better with what it has
seen.
"""

import gymnasium
import networkx
import numpy as np
import pytest
from tiny_pool import tiny_pool

from agents.policies.heuristics import REFERENCE_POLICIES, oracle, replanning
from agents.policies.path_plan import OFF_PATH, WATCHED, plan_paths
from agents.policies.replanning import Replanner
from agents.rollout.episode import roll_out
from agents.rollout.scene_set import roll_out_scene_set
from eval.benchmark.local_policies import PlansAnew
from irs_gym import RadioMap
from irs_gym.datasets.scene_set import scene_set_of
from irs_gym.datasets.splits import FAMILIES, scene_of
from irs_gym.grid import MOVE_LENGTHS, MOVES

ID, RANDOM_ID = "irs_gym:IrsNav-v0", "irs_gym:IrsNavRandom-v0"
POOL = tiny_pool(30, (9, 7), seed=2, blocked=0.6)
B = -np.inf  # an obstacle

# A wall from the ceiling down to the last row but one, and a shelf, so that the way up is no way
# out.
DEAD_END = [
    [0, 0, 0, 0, B, 0, 0],
    [0, 0, B, B, B, 0, 0],
    [0, 0, 0, 0, B, 0, 0],
    [0, 0, 0, 0, B, 0, 0],
    [0, 0, 0, 0, B, 0, 0],
    [0, 0, 0, 0, 0, 0, 0],
]


def floor(rows, **arguments) -> gymnasium.Env:
    """An environment over a map given as rows, the largest y first."""
    radio_map = RadioMap.from_array(np.array(rows, dtype=float)[::-1].T, 0.5)
    return gymnasium.make(ID, radio_map=radio_map, target_db=-60.0, **arguments)


def test_it_walks_into_a_dead_end_that_it_cannot_see_and_out_again():
    env = floor(DEAD_END, start=(0, 3), goal=(6, 3), patch_radius=1)
    # East while the wall is out of sight; down as the shelf bars the way up; of two last moves
    # equally good the first.
    expected = [(0, 3), (1, 3), (2, 3), (3, 3), (3, 2), (3, 1), (4, 0), (5, 1), (6, 2), (6, 3)]
    episode = roll_out(replanning(env), env)
    assert episode.path.tolist() == [list(cell) for cell in expected]
    assert episode.is_success
    assert episode.distance > episode.oracle_distance


def test_with_the_whole_map_in_view_it_is_the_oracle():
    for arguments in (
        {"patch_radius": 40},
        {"observation": "flat", "patch_radius": 39},
        {"observation": "map"},
    ):
        env = gymnasium.make(ID, target_db=-61.0, **arguments)
        for start in (None, (20, 36)):
            options = {"start": start} if start else None
            ours, best = (
                roll_out(make(env), env, options=options) for make in (replanning, oracle)
            )
            assert ours.path.tolist() == best.path.tolist()


@pytest.mark.parametrize(
    ("observation", "radius"), [("dict", 1), ("flat", 2), ("dict", 3), ("map", 1)]
)
def test_each_move_begins_a_shortest_path_over_what_it_has_not_seen_to_be_infeasible(
    observation, radius
):
    env = gymnasium.make(RANDOM_ID, scenes=POOL, observation=observation, patch_radius=radius)
    policy, optimal = replanning(env), 0
    for number in range(len(POOL)):
        episode = roll_out(policy, env, options={"scene_id": number})
        assert episode.is_success
        assert episode.refused == 0
        optimal += episode.is_optimal
        hoped = np.ones(POOL.shape, dtype=bool)
        for cell, after in zip(episode.path[:-1], episode.path[1:], strict=True):
            near = (
                (slice(None), slice(None))
                if observation == "map"
                else tuple(slice(max(at - radius, 0), at + radius + 1) for at in cell)
            )
            hoped[near] = POOL.feasible[number][near]
            to_go = lengths(hoped, tuple(POOL.goal[number].tolist()))
            step = np.flatnonzero((after - cell == MOVES).all(axis=1))[0]
            assert MOVE_LENGTHS[step] + to_go[tuple(after.tolist())] == pytest.approx(
                to_go[tuple(cell.tolist())]
            )
    assert (optimal == len(POOL)) == (observation == "map")


def lengths(free: np.ndarray, goal: tuple[int, int]) -> dict[tuple[int, int], float]:
    """Lengths in cells of the shortest paths to the goal, by networkx."""
    graph = networkx.Graph()
    for cell in map(tuple, np.argwhere(free).tolist()):
        for (di, dj), length in zip(MOVES.tolist(), MOVE_LENGTHS.tolist(), strict=True):
            there = (cell[0] + di, cell[1] + dj)
            if 0 <= there[0] < free.shape[0] and 0 <= there[1] < free.shape[1] and free[there]:
                graph.add_edge(cell, there, weight=length)
    return networkx.single_source_dijkstra_path_length(graph, goal)


def test_a_robot_that_sees_no_neighbours_learns_from_refusals():
    env = gymnasium.make(RANDOM_ID, scenes=POOL, patch_radius=0, max_episode_steps=400)
    episodes = [roll_out(replanning(env), env, options={"scene_id": n}) for n in range(len(POOL))]
    assert all(each.is_success for each in episodes)
    assert sum(each.refused for each in episodes) > 0


def test_batches_act_as_single_robots_do_each_with_a_memory_of_its_own():
    kwargs = {"scenes": POOL, "observation": "flat", "patch_radius": 1}
    env = gymnasium.make(RANDOM_ID, **kwargs)
    expected = [
        roll_out(replanning(env), env, options={"scene_id": n}).path.tolist() for n in range(6)
    ]
    batch = gymnasium.make_vec(RANDOM_ID, num_envs=6, autoreset_mode="SameStep", **kwargs)
    policy, state, starts, walked = replanning(batch), None, np.ones(6, dtype=bool), {}
    observation, _ = batch.reset(options={"scene_id": list(range(6))})
    while len(walked) < 6:
        actions, state = policy.predict(observation, state, starts)
        observation, _, starts, _, _ = batch.step(actions)
        for n in np.flatnonzero(starts).tolist():
            walked.setdefault(n, np.asarray(batch.paths()[n]).tolist())
    assert [walked[n] for n in range(6)] == expected


def test_a_new_episode_forgets_what_was_seen():
    env = floor(DEAD_END, start=(0, 3), goal=(6, 3), patch_radius=1)
    policy = replanning(env)
    observation, _ = env.reset()
    _, fresh = policy.predict(observation, None, np.array([True]))
    state = fresh
    for _ in range(5):
        action, state = policy.predict(observation, state, np.array([False]))
        observation = env.step(int(action))[0]
    assert not state.is_open[0].all()
    observation, _ = env.reset()
    assert policy.predict(observation, state, np.array([True]))[1].is_open[0].all()
    assert not policy.predict(observation, state, np.array([False]))[1].is_open[0].all()


def test_it_is_one_of_the_references():
    env = gymnasium.make(ID)
    assert roll_out(REFERENCE_POLICIES["replanning"](env, 0), env).is_success


# Kinds of factories of every sort; in mazes, spirals and zigzags paths are cut at every third step.
KINDS = ("test", "ood-clutter", "ood-irs", "ood-rooms", *(f"ood-{name}" for name in FAMILIES))
FACTORIES = scene_set_of([scene_of(kind, 0) for kind in KINDS])


@pytest.mark.parametrize("corner_cutting", [True, False])
def test_a_path_that_is_followed_is_the_one_that_planning_anew_would_give(corner_cutting):
    shape = FACTORIES.shape
    followed = roll_out_scene_set(Replanner(shape, 5, corner_cutting), FACTORIES, "flat", 200)
    anew = roll_out_scene_set(PlansAnew(shape, 5, corner_cutting), FACTORIES, "flat", 200)
    np.testing.assert_array_equal(followed.actions, anew.actions)
    assert followed.is_success.mean() > 0.8


@pytest.mark.parametrize("radius", [0, 1, 3])
@pytest.mark.parametrize("corner_cutting", [True, False])
def test_that_holds_for_a_robot_alone_and_whatever_it_sees(radius, corner_cutting):
    env = gymnasium.make_vec(
        RANDOM_ID, num_envs=1, scenes=POOL, observation="flat", patch_radius=radius
    )
    policies = [each(POOL.shape, radius, corner_cutting) for each in (Replanner, PlansAnew)]
    states, begins = [None, None], np.ones(1, dtype=bool)
    observation, _ = env.reset(seed=3)
    for _ in range(150):
        both = [p.predict(observation, s, begins) for p, s in zip(policies, states, strict=True)]
        (ours, expected), states = zip(*both, strict=True)
        assert ours.tolist() == expected.tolist()
        observation, _, terminated, truncated, _ = env.step(ours)
        begins = terminated | truncated


def test_a_robot_that_is_moved_off_its_path_plans_from_where_it_is():
    env = gymnasium.make_vec(RANDOM_ID, num_envs=8, scenes=POOL, observation="flat", patch_radius=1)
    policies = [each(POOL.shape, 1) for each in (Replanner, PlansAnew)]
    states, begins = [None, None], np.ones(8, dtype=bool)
    observation, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        both = [p.predict(observation, s, begins) for p, s in zip(policies, states, strict=True)]
        (ours, expected), states = zip(*both, strict=True)
        assert ours.tolist() == expected.tolist()
        is_pushed = rng.random(8) < 0.3
        observation, _, terminated, truncated, _ = env.step(
            np.where(is_pushed, rng.integers(8, size=8), ours)
        )
        begins = terminated | truncated


def open_cells(rng: np.random.Generator) -> np.ndarray:
    return rng.random(rng.integers(2, 14, size=2)) < rng.choice([0.5, 0.7, 0.9])


def plan_over(is_open: np.ndarray, start: int, goal: int, corner_cutting: bool) -> np.ndarray:
    cost = np.where(is_open, 1.0, np.inf)[None]
    return plan_paths(cost, np.array([start]), np.array([goal]), corner_cutting)[0]


@pytest.mark.parametrize("corner_cutting", [True, False])
def test_a_path_takes_the_moves_of_a_search_over_the_whole_map(corner_cutting):
    rng = np.random.default_rng(1)
    for _ in range(300):
        is_open = open_cells(rng)
        start, goal = rng.integers(is_open.size, size=2).tolist()
        moves = plan_over(is_open, start, goal, corner_cutting)
        expected = PlansAnew(is_open.shape, 1, corner_cutting)._moves(is_open, goal)
        is_path = moves >= 0
        np.testing.assert_array_equal(moves[is_path], expected[is_path])
        assert is_path[start]


@pytest.mark.parametrize("corner_cutting", [True, False])
def test_a_path_depends_on_no_cell_that_it_does_not_tell(corner_cutting):
    rng = np.random.default_rng(2)
    seen = {True: 0, False: 0}
    for _ in range(300):
        is_open = open_cells(rng)
        start, goal = rng.integers(is_open.size, size=2).tolist()
        moves = plan_over(is_open, start, goal, corner_cutting)
        for cell in np.flatnonzero(is_open.ravel() & (np.arange(is_open.size) != start)):
            fewer = is_open.copy()
            fewer.ravel()[cell] = False
            is_same = np.array_equal(plan_over(fewer, start, goal, corner_cutting), moves)
            if moves[cell] == OFF_PATH:
                assert is_same
            elif moves[cell] == WATCHED:
                seen[is_same] += 1
    assert seen[False]
    assert not seen[True]  # nor does it tell others


def test_a_goal_out_of_reach_has_a_plan_of_one_move():
    is_open = np.ones((6, 6), dtype=bool)
    is_open[3] = False
    moves = plan_over(is_open, 0, 35, True)
    assert moves[0] == 0
    assert (moves[1:] == OFF_PATH).all()


def test_a_path_that_begins_at_its_goal_leads_out_and_back():
    moves = plan_over(np.ones((3, 3), dtype=bool), 4, 4, True).reshape(3, 3)
    assert moves[1, 1] == 0
    assert moves[2, 1] == 4
    assert (moves >= 0).sum() == 2


def test_a_cell_that_is_not_on_the_map_is_refused():
    cost = np.ones((1, 3, 4))
    for start, goal, said in (
        (12, 0, "starts: cell 12"),
        (0, -1, "goals: cell -1"),
        (0, 10**12, "goals: cell 1000000000000"),
    ):
        with pytest.raises(ValueError, match=rf"{said} is not on a map of \(3, 4\) cells"):
            plan_paths(cost, np.array([start]), np.array([goal]))


def test_an_observation_of_a_place_off_the_map_is_refused():
    env = gymnasium.make(RANDOM_ID, scenes=POOL, observation="flat", patch_radius=1)
    observation, _ = env.reset(seed=0)
    observation[-2:] = 7.0  # towards the goal
    with pytest.raises(ValueError, match="goals: cell"):
        Replanner(POOL.shape, 1).predict(observation)
