"""Facts about the vector environment's infos: a dict like any other, computed when looked at."""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest

from irs_gym.infos import Infos, only


@pytest.fixture
def infos() -> Infos:
    env = gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=3)
    env.reset(seed=0)
    return env.step(np.array([0, 1, 4]))[4]


def test_a_key_is_computed_when_asked_for_and_kept(infos):
    assert dict.__len__(infos) == 0
    assert infos["distance"].tolist() == [0.5, 0.5 * 2**0.5, 0.0]
    assert dict.__len__(infos) == 1
    assert infos["distance"] is infos["distance"]


def test_every_way_to_look_at_all_sees_all(infos):
    expected = {key: value.tolist() for key, value in copy.copy(infos).items()}
    assert len(expected) == 20

    def fresh():
        return Infos(infos.step)

    ways = [
        dict,
        lambda d: {**d},
        lambda d: d | {},
        lambda d: {} | d,
        lambda d: d.copy(),
        lambda d: dict(d.items()),
        lambda d: dict(zip(d.keys(), d.values(), strict=True)),
        lambda d: {key: d[key] for key in d},
        lambda d: {key: d.get(key) for key in expected},
        copy.deepcopy,
        lambda d: pickle.loads(pickle.dumps(d)),
        lambda d: dict(json.loads(json.dumps({key: value.tolist() for key, value in d.items()}))),
        lambda d: {key: d.pop(key) for key in list(d)},
    ]
    for number, way in enumerate(ways):
        seen = {key: np.asarray(value).tolist() for key, value in way(fresh()).items()}
        assert seen == expected, number
    assert len(fresh()) == 20
    assert "'spl'" in repr(fresh())
    assert len([*reversed(fresh())]) == 20


def test_membership_costs_nothing_and_unknown_keys_are_missing(infos):
    assert "spl" in infos
    assert "final_info" not in infos
    assert dict.__len__(infos) == 0
    assert infos.get("final_info") is None
    with pytest.raises(KeyError):
        infos["final_info"]


def test_it_takes_and_loses_keys_like_a_dict(infos):
    infos["episode"] = 1
    infos.update(more=2)
    assert (infos["episode"], infos["more"], infos.setdefault("last", 3)) == (1, 2, 3)
    del infos["episode"]
    assert "episode" not in infos
    assert infos.pop("spl").tolist() == [0, 0, 0]
    assert "spl" not in infos
    with pytest.raises(KeyError):
        infos["spl"]


def test_only_zeroes_the_others():
    chosen = np.array([True, False])
    assert only(np.array([1.5, 2.5]), chosen).tolist() == [1.5, 0.0]
    assert only(np.array([[1], [2]], dtype=object), chosen).tolist() == [[1], [None]]
