"""Facts of the leaderboard: what was done is accepted, and whatever differs from it is refused at
the scene and step.
"""

import gzip
import json
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from evaluating import call

from agents.policies.heuristics import RULES
from agents.policies.heuristics import oracle as oracle_policy
from eval.leaderboard import submission as submission_file
from eval.leaderboard.page import leaderboard_page
from eval.leaderboard.replay import play, submission_of, verify
from eval.leaderboard.submission import MOST_BYTES, Agent, Refusal, load, parse, save
from eval.leaderboard.track import TRACKS, split_track, track_of
from irs_gym.grid import MOVES

AGENT = Agent(name="oracle", authors="The irs_gym authors", version="0.1.0", commit=None)
TEST = split_track("test", "all", num_scenes=3)
SOME = {TEST.name: TEST}  # in place of the 1,000 scenes of that name
PAPER = TRACKS["paper-61.8dB-continuous"]
HARD = TRACKS["paper-60.0dB-continuous"]
KNOWN = {**TRACKS, **SOME}


def way_of(track, rule):
    """What a rule does in each scene of a track, until the episode is over."""
    env = track.make_env(observation="cell")
    ways = []
    for scene in track.scenes:
        env.reset(options=track.options(scene))
        inner = env.unwrapped
        choices = RULES[rule](inner.world, inner.world.goal)
        way = []
        is_over = False
        while not is_over:
            way.append(int(choices[inner.path[-1]].argmax()))
            *_, terminated, truncated, _ = env.step(way[-1])
            is_over = terminated or truncated
        ways.append(way)
    return ways


@pytest.fixture(scope="module")
def honest():
    """The oracle's submission for three test scenes, as plain data."""
    return json.loads(submission_of(TEST, way_of(TEST, "oracle"), AGENT).model_dump_json())


def refused(data) -> str:
    """Why a submission is refused."""
    content = data if isinstance(data, bytes) else json.dumps(data).encode()
    with pytest.raises(Refusal) as caught:
        verify(parse(content), KNOWN)
    return str(caught.value)


def test_what_was_done_is_accepted_and_optimal_where_it_is(honest):
    found = verify(parse(json.dumps(honest).encode()), SOME)
    assert found.scores.optimal == 3
    assert found.scores.spl == found.scores.success == found.scores.ratio == 1.0
    assert [each.refused for each in found.outcomes] == [0, 0, 0]


def test_a_failure_is_accepted_as_one():
    found = verify(submission_of(PAPER, way_of(PAPER, "greedy"), AGENT))
    (outcome,) = found.outcomes
    assert not outcome.is_success
    assert outcome.spl == found.scores.success == found.scores.optimal == 0
    assert found.scores.ratio is None


@pytest.fixture(scope="module")
def detour():
    """The oracle's way in the paper's scene at -60 dB, a step on it, and a move there into a cell
    below the target.
    """
    (way,) = way_of(HARD, "oracle")
    env = HARD.make_env(observation="cell")
    env.reset()
    inner = env.unwrapped
    for step, move in enumerate(way):
        for action, cell in enumerate((np.array(inner.path[-1]) + MOVES).tolist()):
            is_on_map = inner.radio_map.grid.has(tuple(cell))
            gain_db = inner.radio_map.gain_db[tuple(cell)] if is_on_map else -np.inf
            if -np.inf < gain_db < inner.world.target_db:
                return way, step, action
        env.step(move)
    raise AssertionError("no such cell beside the path")


def with_letter(data, step, letter):
    """The submission with another letter at a step of its one episode."""
    changed = deepcopy(data)
    own = changed["episodes"][0]
    own["actions"] = own["actions"][:step] + letter + own["actions"][step + 1 :]
    return json.dumps(changed).encode()


def test_a_move_into_a_cell_below_the_target_is_refused_at_its_step(detour):
    way, step, action = detour
    data = json.loads(submission_of(HARD, [way], AGENT).model_dump_json())
    said = refused(with_letter(data, step, str(action)))
    assert said.startswith(f"scene 'paper', step {step + 1}: the move ")
    assert "below the target of -60.000 dB; it is said to be made" in said


def test_a_refused_move_is_accepted_as_such_and_as_nothing_else(detour):
    way, step, action = detour
    longer = [*way[:step], action, *way[step:]]
    data = json.loads(submission_of(HARD, [longer], AGENT).model_dump_json())
    assert data["episodes"][0]["actions"][step] == "abcdefgh"[action]
    (outcome,) = verify(parse(json.dumps(data).encode())).outcomes
    assert outcome.refused == 1
    assert outcome.is_optimal

    said = refused(with_letter(data, step, str(action)))
    assert f"step {step + 1}: the move" in said
    said = refused(with_letter(data, step + 1, "abcdefgh"[way[step]]))
    assert f"step {step + 2}: the move" in said
    assert said.endswith("is made; it is said to be refused")


def with_episode(number, **changes):
    def tamper(data):
        data["episodes"][number].update(changes)

    return tamper


def with_actions(change):
    def tamper(data):
        data["episodes"][1]["actions"] = change(data["episodes"][1]["actions"])

    return tamper


def with_top(**changes):
    return lambda data: data.update(changes)


def swapped(data):
    episodes = data["episodes"]
    episodes[0], episodes[1] = episodes[1], episodes[0]


def other_start(data):
    """The actions of another start: those of the third scene."""
    for key in ("actions", "distance"):
        data["episodes"][1][key] = data["episodes"][2][key]


TAMPERED = {
    "wrong hash of a scene": (with_episode(1, sha256="00000000"), r"scene 'test-1': its SHA-256"),
    "unknown scene": (with_episode(1, scene="test-7"), r"scene 'test-7': it is none"),
    "scene missing": (lambda d: d["episodes"].pop(1), r"scene 'test-1': it is missing"),
    "scene twice": (lambda d: d["episodes"].append(d["episodes"][1]), r"scene 'test-1': it stands"),
    "scenes out of order": (swapped, r"scene 'test-1': it stands out of order"),
    "teleport": (with_actions(lambda a: a[:5] + "9" + a[6:]), r"'test-1', step 6: '9' is no"),
    "a letter that is none": (with_actions(lambda a: a[:5] + "x"), r"'test-1', step 6: 'x' is no"),
    "a digit of another script": (with_actions(lambda a: "٣" + a), r"'test-1', step 1: '٣' is no"),
    "action after the end": (with_actions(lambda a: a + "0"), r"'test-1', step \d+: .* was over"),
    "list cut short": (with_actions(lambda a: a[:-1]), r"'test-1', step \d+: the list ends"),
    "no action": (with_actions(lambda a: ""), r"'test-1', step 0: the list ends"),
    "actions of another start": (other_start, r"scene 'test-1', step \d+"),
    "another distance": (with_episode(1, distance=1.0), r"'test-1', step \d+: .* travelled"),
    "failure claimed": (
        with_episode(1, is_success=False),
        r"'test-1', step \d+: the robot reaches",
    ),
    "better SPL": (lambda d: d["scores"].update(spl=0.5), r"scores.spl: 0.5 is claimed"),
    "more optimal": (lambda d: d["scores"].update(optimal=4), r"scores.optimal: 4 is claimed"),
    "no ratio": (lambda d: d["scores"].update(ratio=None), r"scores.ratio: None is claimed"),
    "other seed": (with_top(seed=1), r"seed: 1 is not that of test-map"),
    "other id": (with_top(env_id="IrsNav-v0"), r"env_id: "),
    "unknown track": (with_top(track="moon"), r"track: 'moon' is none of test-map"),
    "other target": (lambda d: d["arguments"].update(target_db=-90.0), r"arguments: .*-90"),
    "argument left out": (lambda d: d["arguments"].pop("split"), r"arguments: "),
    "float for an integer": (lambda d: d["arguments"].update(num_scenes=3.0), r"arguments: "),
    "a start of its own": (with_episode(1, start=[0, 0]), r"episodes.1.start: Extra"),
    "extra key": (with_top(path="/etc/passwd"), r"path: Extra"),
    "key left out": (lambda d: d.pop("seed"), r"seed: Field required"),
    "actions as floats": (with_episode(1, actions=[0.0, 1.0]), r"episodes.1.actions: "),
    "actions as bools": (with_episode(1, actions=[True, False]), r"episodes.1.actions: "),
    "success as a number": (with_episode(1, is_success=1), r"episodes.1.is_success: "),
    "distance as text": (with_episode(1, distance="23.2"), r"episodes.1.distance: "),
    "NaN": (with_episode(1, distance=float("nan")), r"episodes.1.distance: "),
    "infinite": (lambda d: d["scores"].update(spl=float("inf")), r"scores.spl: "),
    "negative distance": (with_episode(1, distance=-1.0), r"episodes.1.distance: "),
    "a seed of a thousand digits": (with_top(seed=10**1000), r"seed: "),
    "a number beyond all": (lambda d: d["scores"].update(success=10**400), r"scores.success: "),
    "a name over two lines": (lambda d: d["agent"].update(name="a\nb"), r"agent.name: "),
    "a name without end": (lambda d: d["agent"].update(name="a" * 101), r"agent.name: "),
    "no commit": (lambda d: d["agent"].update(commit="; rm -rf"), r"agent.commit: "),
    "other format": (with_top(format_version=2), r"format_version: "),
    "no episodes": (with_top(episodes=[]), r"episodes: "),
}


@pytest.mark.parametrize("name", TAMPERED)
def test_a_tampered_submission_is_refused(honest, name):
    tamper, message = TAMPERED[name]
    data = deepcopy(honest)
    tamper(data)
    with pytest.raises(Refusal, match=message):
        verify(parse(json.dumps(data).encode()), SOME)


def twice(content: bytes) -> bytes:
    return content.replace(b'{"format_version"', b'{"seed": 7, "format_version"')


CONTENTS = {
    "not JSON": b"\x80\x04\x95 a pickle",
    "empty": b"",
    "a list": b"[]",
    "nested without end": b"[" * 100_000,
    "nested in a field": b'{"agent": ' + b'{"a":' * 100_000,
    "a bomb": gzip.compress(b" " * 50 * MOST_BYTES),
    "a bomb in a bomb": gzip.compress(gzip.compress(b" " * MOST_BYTES)),
    "half an archive": gzip.compress(b'{"format_version": 1}' * 99)[:-9],
    "two archives": gzip.compress(b"{}") * 2,
    "not UTF-8": b'{"format_version": "\xff\xfe"}',
    "half a character": b'{"format_version": 1, "track": "\\ud800"}',
}


@pytest.mark.parametrize("name", CONTENTS)
def test_content_that_is_no_submission_is_refused(name):
    assert refused(CONTENTS[name])


def test_a_key_that_stands_twice_is_refused(honest):
    content = json.dumps(honest).encode()
    assert "the key 'seed' stands twice" in refused(twice(content))


def test_a_large_file_is_not_read(tmp_path):
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(MOST_BYTES + 1)

    with pytest.raises(ValueError, match="at most"):
        load(tmp_path / "large.json")


def test_a_submission_of_1000_scenes_is_small(honest):
    one = honest["episodes"][0]
    many = {**honest, "episodes": [{**one, "actions": "01234567" * 6}] * 1000}
    assert len(gzip.compress(json.dumps(many).encode())) < len(json.dumps(many)) < MOST_BYTES / 4


def test_tracks_are_of_frozen_scenes_and_the_pretrained_problems():
    assert {track.split for track in TRACKS.values()} == {
        None, "test", "ood-clutter", "ood-irs", "ood-size", "ood-rooms",
    }  # fmt: skip
    for name, track in TRACKS.items():
        assert name == track.name
        assert len(track.scenes) == (1 if track.split is None else 1000)
    assert TRACKS["ood-size-local"].arguments["max_episode_steps"] == 800
    with pytest.raises(ValueError, match="track='moon' must be one of paper-"):
        track_of("moon")


def test_a_policy_is_played_on_a_track_and_its_file_verified(tmp_path):
    env = PAPER.make_env()
    found = submission_of(PAPER, play(PAPER, oracle_policy(env, 0)), AGENT)
    save(found, tmp_path / "a.json")
    save(found, tmp_path / "a.json.gz")
    assert load(tmp_path / "a.json") == load(tmp_path / "a.json.gz") == found
    (outcome,) = verify(found).outcomes
    assert outcome.is_optimal
    assert outcome.distance == pytest.approx(23.228, abs=1e-3)


def test_names_on_the_page_are_text(honest):
    data = deepcopy(honest)
    data["agent"]["name"] = "<script>|[x](y)"
    found = verify(parse(json.dumps(data).encode()), SOME)
    page = leaderboard_page({Path("a b.json"): found}, "docs/leaderboard", "", SOME)
    assert "<script>" not in page
    assert "&lt;script&gt;\\|" in page
    assert "3 of 3" in page


def test_commands_submit_verify_and_write_the_page(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "docs" / "leaderboard"
    words = ("submit", "oracle", "ppo", "--track", PAPER.name, "--authors", "We", "--out", folder)
    assert call(monkeypatch, *words) == 0
    files = sorted((folder / PAPER.name).iterdir())
    assert [each.name for each in files] == ["oracle.json.gz", "ppo.json.gz"]
    assert call(monkeypatch, "verify", *files) == 0
    assert "1 of 1 episodes are optimal" in capsys.readouterr().out

    page = ("leaderboard", "--folder", folder, "--out", tmp_path / "docs")
    assert call(monkeypatch, *page) == 0
    text = (tmp_path / "docs" / "leaderboard.md").read_text()
    assert f"[actions](leaderboard/{PAPER.name}/ppo.json.gz)" in text
    assert "PPO" in text

    data = load(files[0]).model_dump(mode="json")
    data["episodes"][0]["distance"] = 1.0
    (folder / PAPER.name / "false.json").write_text(json.dumps(data))
    assert call(monkeypatch, "verify", folder / PAPER.name / "false.json", files[0]) == 1
    assert "false.json: refused: scene 'paper', step" in capsys.readouterr().err
    assert call(monkeypatch, *page) == 2
    assert "false.json" in capsys.readouterr().err
    assert (tmp_path / "docs" / "leaderboard.md").read_text() == text

    assert call(monkeypatch, "verify", tmp_path / "none.json") == 2
    assert call(monkeypatch, "verify") == 2


def test_submit_refuses_before_it_plays(tmp_path, monkeypatch, capsys):
    def said(*words):
        assert call(monkeypatch, "submit", *words, "--out", tmp_path / "out") == 2
        return capsys.readouterr().err

    assert "must be one of" in said("oracle", "--track", "moon", "--authors", "We")
    assert "sees the whole map" in said("planner", "--track", "test-local", "--authors", "We")
    assert "learned in one scene" in said("ppo", "--track", "test-map", "--authors", "We")
    assert "authors" in said("oracle", "--track", PAPER.name, "--authors", "")
    assert not (tmp_path / "out").exists()


def test_the_committed_files_are_within_limits_and_of_their_tracks():
    root = Path(submission_file.__file__).parents[2] / "docs" / "leaderboard"
    files = sorted(root.glob("*/*"))
    assert files
    assert {file.parent.name for file in files} <= set(TRACKS)
    assert all(file.stat().st_size < MOST_BYTES for file in files)


def test_the_committed_submissions_of_the_paper_are_accepted():
    root = Path(submission_file.__file__).parents[2] / "docs" / "leaderboard"
    found = [verify(load(file)) for file in sorted(root.glob(f"{PAPER.name}/*"))]
    best = {each.submission.agent.name for each in found if each.scores.optimal == 1}
    assert {"PPO", "DQN", "oracle"} <= best
