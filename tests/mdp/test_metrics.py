"""Facts of the metrics: what they are bounded by, and what they say of failures."""

import numpy as np
import pytest

from agents.rollout.episode import EpisodeResult
from agents.rollout.scene_set import SceneSetResults
from irs_gym.mdp.metrics import distance_ratio, soft_spl, spl

RNG = np.random.default_rng(0)
ORACLE = RNG.uniform(1.0, 30.0, 200)
DISTANCE = ORACLE * RNG.uniform(0.5, 3.0, 200)
IS_SUCCESS = RNG.random(200) < 0.6
PROGRESS = RNG.random(200)


def test_spl_is_the_oracles_distance_over_the_robots_and_0_in_a_failure():
    found = spl(IS_SUCCESS, ORACLE, DISTANCE)
    assert (found[~IS_SUCCESS] == 0).all()
    wanted = np.minimum(1.0, ORACLE / DISTANCE)[IS_SUCCESS]
    np.testing.assert_allclose(found[IS_SUCCESS], wanted, rtol=1e-15)


def test_a_path_a_rounding_shorter_than_the_oracles_scores_no_more_than_1():
    assert spl(True, 10.0, np.nextafter(10.0, 0.0)) == 1.0


def test_soft_spl_is_spl_with_the_progress_in_place_of_success():
    np.testing.assert_array_equal(
        soft_spl(IS_SUCCESS, ORACLE, DISTANCE), spl(IS_SUCCESS, ORACLE, DISTANCE)
    )
    np.testing.assert_allclose(
        soft_spl(PROGRESS, ORACLE, DISTANCE),
        PROGRESS * spl(np.ones(200, dtype=bool), ORACLE, DISTANCE),
        rtol=1e-15,
    )


def test_the_ratio_says_nothing_of_failures():
    found = distance_ratio(IS_SUCCESS, ORACLE, DISTANCE)
    np.testing.assert_array_equal(np.isnan(found), ~IS_SUCCESS)
    np.testing.assert_array_equal(found[IS_SUCCESS], (DISTANCE / ORACLE)[IS_SUCCESS])


def test_one_episode_and_a_whole_set_are_scored_alike():
    together = SceneSetResults(IS_SUCCESS, DISTANCE, ORACLE)
    each = [
        EpisodeResult(
            is_success=bool(IS_SUCCESS[n]),
            distance=float(DISTANCE[n]),
            oracle_distance=float(ORACLE[n]),
            spl=float(spl(IS_SUCCESS[n], ORACLE[n], DISTANCE[n])),
            progress=float(IS_SUCCESS[n]),
            refused=0,
            steps=1,
            total_reward=0.0,
            path=np.zeros((2, 2), dtype=np.int64),
        )
        for n in range(200)
    ]
    assert together.spl.tolist() == [one.spl for one in each] == [one.soft_spl for one in each]
    ratios = [one.ratio for one in each if one.ratio is not None]
    assert together.ratio == pytest.approx(np.mean(ratios), rel=1e-15)
