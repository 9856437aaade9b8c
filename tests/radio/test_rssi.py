"""Facts of a measured room: what its files say is what the map holds, and files that say nothing
are refused by name.
"""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import irs_gym
from irs_gym import RadioMap, cost_map, from_rssi_histograms
from irs_gym.radio.rssi import rssi_receivers

LEVELS = [-100.0, -90.0, -80.0, -70.0]
SHAPE = (4, 3)
SIZE = 0.5
LIMITS = [[0.0, 0.0], [1.6, 0.9]]
RNG = np.random.default_rng(0)
SHARES = {name: RNG.dirichlet(np.ones(4), SHAPE) for name in ("a1", "a2")}
SHARES["a2"][1, 1] = [0.0, 0.0, 0.0, 0.0]  # nothing was heard
SHARES["a2"][2, 1] = [0.25, 0.25, 0.0, 0.0]  # half was too weak for the lowest level
FREE = np.array([[0, 1, 0], [1, 1, 1], [1, 1, 1], [0, 1, 0]], dtype=bool)
CELLS = RNG.permutation([(i, j) for i in range(SHAPE[0]) for j in range(SHAPE[1])]).tolist()


def place(cell) -> str:
    return json.dumps([cell[0] * SIZE, cell[1] * SIZE])


def histogram_lines(receiver: str) -> list[str]:
    header = [receiver, json.dumps(LIMITS), str(SIZE), json.dumps(LEVELS)]
    cells = [f"{place(c)}::beacon::{SHARES[receiver][tuple(c)].tolist()}" for c in CELLS]
    return ["::".join(header), *cells]


def occupancy_lines() -> list[str]:
    header = f"{json.dumps(LIMITS)}::{SIZE}"
    return [header, *(f"{place(cell)}::{int(not FREE[tuple(cell)])}" for cell in CELLS)]


def grid_file(folder: Path, receiver: str = "a1") -> Path:
    return folder / "grd" / f"best_{SIZE}" / f"room_rssi_{receiver}_{SIZE}.grd"


def occupancy_file(folder: Path) -> Path:
    return folder / "occ" / f"room_{SIZE}.occ"


@pytest.fixture
def room(tmp_path) -> Path:
    grid_file(tmp_path).parent.mkdir(parents=True)
    occupancy_file(tmp_path).parent.mkdir()
    for receiver in SHARES:
        grid_file(tmp_path, receiver).write_text("\n".join(histogram_lines(receiver)))
    occupancy_file(tmp_path).write_text("\n".join(occupancy_lines()))
    return tmp_path


@pytest.mark.parametrize("receiver", ["a1", "a2"])
def test_the_map_is_what_the_files_say(room, receiver):
    radio_map = from_rssi_histograms(room, receiver=receiver)
    np.testing.assert_array_equal(radio_map.free, FREE)  # of occupancy 0
    assert radio_map.grid.cell_size == SIZE
    assert radio_map.grid.centre((0, 0)) == (0.0, 0.0)
    assert radio_map.grid.centre((3, 2)) == (1.5, 1.0)

    outage = {t: cost_map(radio_map, t, "outage") for t in (-101.0, -90.0, -85.0, 0.0)}
    for i, j in np.argwhere(FREE):
        shares = SHARES[receiver][i, j]
        lost = 1 - sum(shares)
        power = sum(s * 10 ** (level / 10) for s, level in zip(shares, LEVELS, strict=True))
        mean = 10 * np.log10(power) if power else -np.inf
        assert radio_map.gain_db[i, j] == pytest.approx(mean, abs=1e-12)
        assert outage[-101.0][i, j] == pytest.approx(lost, abs=1e-12)
        assert outage[-90.0][i, j] == pytest.approx(lost + shares[0], abs=1e-12)
        assert outage[-85.0][i, j] == pytest.approx(lost + shares[:2].sum(), abs=1e-12)
        assert outage[0.0][i, j] == 1.0
    assert all((each[~FREE] == np.inf).all() for each in outage.values())


def test_the_receivers_are_listed_where_one_is_missing(room):
    assert rssi_receivers(room) == ("a1", "a2")
    for missing in ("a3", None, 7):
        with pytest.raises(ValueError, match=r"^receiver=.* is not in .*, which has a1, a2"):
            from_rssi_histograms(room, receiver=missing)


def test_of_several_resolutions_one_is_chosen(room):
    finer = room / "grd" / "best_0.25"
    finer.mkdir()
    text = "\n".join(histogram_lines("a1")).replace("::0.5::", "::0.25::")
    (finer / "room_rssi_a1_0.25.grd").write_text(text)
    with pytest.raises(ValueError, match=r"^cell_size=None must choose one of grd.best_0.25"):
        from_rssi_histograms(room, receiver="a1")
    with pytest.raises(ValueError, match=r"^cell_size=1.0 must choose one of"):
        from_rssi_histograms(room, receiver="a1", cell_size=1.0)
    assert from_rssi_histograms(room, receiver="a1", cell_size=0.5).grid.shape == SHAPE


def test_the_environments_take_it_as_their_map_and_keep_its_histograms(room, tmp_path):
    radio_map = from_rssi_histograms(room, receiver="a1")
    ends = {"start": (0, 1), "goal": (3, 1), "target_db": -100.0}
    env = gymnasium.make("irs_gym:IrsNav-v0", radio_map=radio_map, **ends)
    env.reset(seed=0)
    assert env.unwrapped.oracle.distance == pytest.approx(1.5)
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    fading = again.unwrapped.radio_map.fading
    np.testing.assert_array_equal(fading.shares, radio_map.fading.shares)

    radio_map.save(tmp_path / "room.npz")
    np.testing.assert_array_equal(
        cost_map(RadioMap.load(tmp_path / "room.npz"), -85.0, "outage"),
        cost_map(radio_map, -85.0, "outage"),
    )


# --- files that say nothing -----------------------------------------------------------------------


def line(number: int, text: str):
    return lambda lines: [*lines[:number], text, *lines[number + 1 :]]


def header(**parts: str):
    def change(lines: list[str]) -> list[str]:
        names = ("receiver", "limits", "size", "levels")
        said = dict(zip(names, lines[0].split("::"), strict=False)) | parts
        return ["::".join(said.values()), *lines[1:]]

    return change


NAN_LINE = f"{place(CELLS[4])}::beacon::[0.5, NaN, 0.0, 0.0]"
OF_HISTOGRAMS = {
    "empty": (lambda _: [], "has no cells"),
    "header alone": (lambda lines: lines[:1], "has no cells"),
    "a line less": (lambda lines: lines[:-1], "11 cells do not fill a grid of 4 x 3"),
    "cut in a line": (
        lambda lines: [*lines[:-1], lines[-1][:30]],
        "must be a row of finite numbers",
    ),
    "cut in a place": (lambda lines: [*lines[:-1], lines[-1][:4]], "has 1 parts .* not 3"),
    "a cell twice": (
        lambda lines: [*lines[:-1], lines[-2]],
        "do not fill a grid|tells a cell twice",
    ),
    "NaN": (line(5, NAN_LINE), "must be a row of finite numbers"),
    "infinite": (line(5, NAN_LINE.replace("NaN", "1e999")), "must be a row of finite numbers"),
    "text": (line(5, NAN_LINE.replace("NaN", '"a"')), "must be a row of finite numbers"),
    "true": (line(5, NAN_LINE.replace("NaN", "true")), "must be a row of finite numbers"),
    "negative": (line(5, NAN_LINE.replace("NaN", "-0.1")), "must not be negative"),
    "more than 1": (line(5, NAN_LINE.replace("NaN", "0.6")), "add up to more than 1"),
    "too many bins": (line(5, NAN_LINE.replace("NaN", "0, 0")), "has 5 numbers, not 4"),
    "nested": (line(5, NAN_LINE.replace("NaN", "[" * 100_000)), "must be a row of finite numbers"),
    "a huge number": (line(5, NAN_LINE.replace("NaN", "9" * 5000)), "must be a row of finite"),
    "off the grid": (line(5, "[0.3, 0.0]::b::[1, 0, 0, 0]"), "lies on no grid of 0.5 m"),
    "far away": (line(5, "[1e300, 0.0]::b::[1, 0, 0, 0]"), "a cell lies 1e.300 m away"),
    "a huge grid": (line(5, "[500000.0, 0.0]::b::[1, 0, 0, 0]"), "do not fill a grid"),
    "a negative place": (line(5, "[-0.5, 0.0]::b::[1, 0, 0, 0]"), "do not fill a grid"),
    "a place in space": (line(5, "[0.0, 0.0, 0.0]::b::[1, 0, 0, 0]"), "cell has 3 numbers, not 2"),
    "another's": (header(receiver="a9"), "tells of receiver 'a9' .* and is named otherwise"),
    "another size": (header(size="0.25"), "in cells of 0.25 m, and is named otherwise"),
    "no size": (header(size="NaN"), "its header tells no grid: cell_size=nan"),
    "no limits": (header(limits="[0, 0]"), "its header tells no grid"),
    "limits of NaN": (header(limits="[[NaN, 0], [1, 1]]"), "its header tells no grid"),
    "falling levels": (header(levels="[-70, -80, -90, -100]"), "increasing numbers of dB"),
    "absurd levels": (header(levels="[-70, -80, -90, 1e300]"), "increasing numbers of dB"),
    "levels cut off": (header(levels="[-100, -90"), "its levels .* must be a row"),
}


@pytest.mark.parametrize(("change", "message"), OF_HISTOGRAMS.values(), ids=OF_HISTOGRAMS)
def test_histograms_that_can_mean_nothing_are_refused(room, change, message):
    grid_file(room).write_text("\n".join(change(histogram_lines("a1"))))
    with pytest.raises(ValueError, match=rf"room_rssi_a1_0\.5\.grd.*({message})"):
        from_rssi_histograms(room, receiver="a1")


OF_OCCUPANCY = {
    "another grid": (
        lambda lines: [each for each in lines if "[1.5," not in each],
        r"has \(3, 3\) cells of 0.5 m .*, the histograms \(4, 3\)",
    ),
    "another origin": (
        lambda lines: [lines[0].replace("[[0.0", "[[-0.5"), *lines[1:]],
        "do not fill a grid",
    ),
    "neither 0 nor 1": (line(3, f"{place(CELLS[2])}::2"), "occupancy '2' is neither 0 nor 1"),
    "cut": (lambda lines: lines[:5], "do not fill a grid"),
}


@pytest.mark.parametrize(("change", "message"), OF_OCCUPANCY.values(), ids=OF_OCCUPANCY)
def test_an_occupancy_that_does_not_fit_is_refused(room, change, message):
    occupancy_file(room).write_text("\n".join(change(occupancy_lines())))
    with pytest.raises(ValueError, match=rf"room_0\.5\.occ.*{message}"):
        from_rssi_histograms(room, receiver="a1")


def test_a_file_cut_anywhere_is_refused(room):
    whole = grid_file(room).read_bytes()
    for length in range(0, len(whole) - 1, 7):
        grid_file(room).write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"\.grd"):
            from_rssi_histograms(room, receiver="a1")


def test_bytes_that_are_no_text_are_refused(room):
    grid_file(room).write_bytes(b"\xff\xfe\x00" * 100)
    with pytest.raises(ValueError, match="is no text"):
        from_rssi_histograms(room, receiver="a1")


def test_a_file_larger_than_the_limit_is_refused_before_it_is_parsed(room, monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "20KiB")
    with pytest.raises(irs_gym.memory.MemoryLimitError, match=r"\.grd.*would take"):
        from_rssi_histograms(room, receiver="a1")


def test_what_is_not_there_is_said_so(room, tmp_path):
    occupancy_file(room).unlink()
    with pytest.raises(FileNotFoundError, match=r"room_0\.5\.occ"):
        from_rssi_histograms(room, receiver="a1")
    for nothing in (tmp_path / "nowhere", tmp_path / "occ"):
        with pytest.raises(FileNotFoundError, match=r"holds no files grd"):
            from_rssi_histograms(nothing, receiver="a1")
    with pytest.raises(ValueError, match=r"^folder=7 must be the path"):
        from_rssi_histograms(7, receiver="a1")
