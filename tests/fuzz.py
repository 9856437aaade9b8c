"""The fuzzer: ``python tests/fuzz.py --inputs 2000`` gives damaged and hostile input to everything
that reads any.

Each target mutates what is valid, so that most of the way in is passed: scene files, map files,
arguments of the public functions and environments, submissions, run folders, and command lines of
``train`` and ``eval``, which are read and checked but not run. An input may be taken, or refused by a clear error
of the project's own; anything else is a failure:

- an exception that is no ``ValueError`` or ``TypeError`` raised by a line of this project, and no
  ``OSError``;
- a warning raised by a line of this project;
- an input that takes longer than `SECONDS`;
- more memory than `BYTES`, which is more than `MEMORY` allows.

The same inputs come each time unless there is a ``--seed``. A failure is shown with the smallest
input that was found.
"""

import argparse
import contextlib
import copy
import faulthandler
import functools
import gzip
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, assume, given, seed, settings
from hypothesis import strategies as st
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 30
MEMORY = "512MiB"  # IRS_GYM_MEMORY of all targets
BYTES = 3 * 2**29  # of address space beyond what a target holds when it begins
OURS = tuple(str(ROOT / each) + os.sep for each in ("irs_gym", "agents", "train", "eval"))


ROBOT = ("corner_cutting", "robot_radius", "collision")
# Of scenes: what robots drive through, and which they cannot solve.
MEANT = r".*(no cell is blocked by|scenes cannot be solved by)"

COUNTS = {"taken": 0, "refused": 0}


class HangError(BaseException):
    """An input that takes too long."""


def is_own(error: BaseException) -> bool:
    """Whether an exception is one that the project means to raise."""
    if isinstance(error, OSError) and error.errno is not None:
        return True
    last = traceback.extract_tb(error.__traceback__)[-1].filename
    return isinstance(error, OSError | ValueError | TypeError) and os.path.abspath(last).startswith(
        OURS
    )


@contextlib.contextmanager
def judged() -> Iterator[None]:
    """Lets pass what is taken or refused in good order, in time."""

    def hang(*_: Any) -> None:
        raise HangError(f"took longer than {SECONDS} s")

    signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    faulthandler.dump_traceback_later(3 * SECONDS, exit=True)  # where not even a signal gets in
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", module=r"(irs_gym|agents|train|eval)(\.|$)")
            warnings.filterwarnings("ignore", message=MEANT)
            yield
            COUNTS["taken"] += 1
    except Exception as error:
        if not is_own(error):
            raise
        COUNTS["refused"] += 1
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0)


# --- mutations ------------------------------------------------------------------------------------

NASTY: list[Any] = [
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2,
        3,
        7,
        17,
        255,
        10**9,
        2**31,
        2**63,
        -(2**63),
        10**30,
        10**400,
    ),
    *(0.5, -0.0, 1e-12, 1e-9, 1e-320, 5e-324, 1e300, -1e300, 1e308, 1e6, 1e-3, 0.1, 0.3),
    *(float("nan"), float("inf"), float("-inf")),
    *(
        "",
        "0.5",
        "paper",
        "x_min",
        "../../etc/passwd",
        "/dev/zero",
        "a\0b",
        "\ud800",
        "é" * 300,
        "[0, 1]",
    ),
    *([], {}, [0], [0, 0], [0.5, 20], [1, 2, 3], [[0]], [None, None], [True, False], {"a": 1}),
]
# Most of the way in is passed by few inputs that are wrong by more than a number.
numbers = (
    st.floats(-20, 20).map(lambda x: round(x, 1))
    | st.integers(0, 12)
    | st.sampled_from([each for each in NASTY if isinstance(each, int | float)])
)
values = (
    st.sampled_from(NASTY) | st.integers() | st.floats() | st.floats(-30, 30) | st.text(max_size=5)
)
hows = st.sampled_from(["put", "drop", "twice", "add"])
change = st.tuples(st.integers(0, 10**6), st.just("number"), numbers)
changes = st.lists(change | change | st.tuples(st.integers(0, 10**6), hows, values), max_size=3)
damages = st.lists(
    st.tuples(
        st.integers(0, 10**6),
        st.sampled_from(["flip", "cut", "insert"]),
        st.binary(min_size=1, max_size=8),
    ),
    max_size=2,
)


def places(part: Any) -> Iterator[tuple[Any, Any]]:
    """Each container of a tree of JSON with each of its keys."""
    for key in list(part) if isinstance(part, dict) else range(len(part)):
        yield part, key
        if isinstance(part[key], dict | list):
            yield from places(part[key])


def mutated(tree: Any, wanted: list[tuple[int, str, Any]]) -> Any:
    """A copy of a tree of JSON with some of its values put, dropped, doubled or added to."""
    tree = json.loads(json.dumps(tree))
    for number, how, drawn in wanted:
        value = copy.deepcopy(drawn)  # one value may be drawn twice: a tree must not hold itself
        found = [
            each
            for each in places(tree)
            if how != "number" or isinstance(each[0][each[1]], int | float)
        ]
        if not found:
            break
        part, key = found[number % len(found)]
        if how == "drop":
            del part[key]
        elif how == "twice" and isinstance(part, list):
            part.append(part[key])
        elif how == "add" and isinstance(part, dict):
            part["a" if not isinstance(value, str) else value] = 1
        else:
            part[key] = value
    return tree


def damaged(content: bytes, wanted: list[tuple[int, str, bytes]]) -> bytes:
    """Bytes of which some are turned, cut off or inserted."""
    for number, how, more in wanted:
        place = number % (len(content) + 1)
        if how == "cut":
            content = content[:place]
        elif how == "flip":
            content = content[:place] + bytes(b ^ 0xFF for b in more) + content[place + len(more) :]
        else:
            content = content[:place] + more + content[place:]
    return content


def as_json(tree: Any) -> bytes:
    """A tree of JSON as text, whatever numbers are in it."""
    with contextlib.suppress(ValueError):
        return json.dumps(tree).encode(errors="surrogatepass")
    return json.dumps(tree, default=str, skipkeys=True).encode()


# --- scenes ---------------------------------------------------------------------------------------


# What a scene of format 2 has beyond one of format 1.
FORMAT_2: list[dict[str, Any]] = [
    {
        "obstacles": [
            {"polygon": [[-6, -6], [-2, -7], [-3, -3]], "height": 2.0},
            {
                "polygon": [[2, -6], [7, -6], [7, -2], [2, -2]],
                "holes": [[[3, -5], [6, -5], [6, -3], [3, -3]]],
                "height": 1.3,
            },
        ],
        "path_loss": "InF-DL",
    },
    {
        "obstacles": [
            {
                "origin": [-4, -2],
                "cell_size": 0.5,
                "rows": ["##..##", "######", ".#..#."],
                "height": 2,
            },
            {"center": [5, 5], "size": [2, 0.2, 3]},
        ],
        "path_loss": {"wall_loss_db": 3.4},
    },
    {
        "room": {
            "polygon": [[-10, -10], [10, -10], [10, 4], [2, 10], [-10, 10]],
            "holes": [[[-1, -1], [1, -1], [0, 1]]],
            "height": 5.0,
        },
        "obstacles": [{"polygon": [[4, -6], [6, -6], [5, -4]], "height": 5.0}],
        "access_points": [{"position": [-10, 5, 2]}],
        "irs_panels": [
            {
                "position": [6, 7, 2],
                "wall": 143.1301,
                "columns": 4,
                "rows": 3,
                "elements_per_subsurface": [1, 5],
                "pitch_wavelengths": 0.5,
            }
        ],
    },
]


def scenes(folder: Path) -> Callable[[], None]:
    """Scene files, their maps and their environments."""
    from irs_gym import build_radio_map, load_scene
    from irs_gym.envs.nav import IrsNavEnv
    from irs_gym.radio.scene import load_scenes, scene_names

    bases = [json.loads(load_scene(name).model_dump_json()) for name in scene_names()]
    bases += [{**bases[0], "format_version": 2, **each} for each in FORMAT_2]
    file = folder / "scene.json"

    @given(
        st.sampled_from(bases),
        changes,
        st.integers(0, 9).flatmap(lambda n: damages if n == 5 else st.just([])),
        st.sampled_from([1.0, 1.0, 2.0, 0.5, 4.0, 1e-4]),
        st.sampled_from(
            [
                {},
                {"phase_bits": 1},
                {"phase_bits": 2, "quantiser": "optimal"},
                {"array_model": "spherical"},
            ]
        ),
    )
    def target(base: Any, wanted: Any, broken: Any, cell_size: float, hardware: Any) -> None:
        file.write_bytes(damaged(as_json(mutated(base, wanted)), broken))
        with judged():
            scene = load_scene(file)
            load_scenes(folder)
            radio_map = build_radio_map(scene, cell_size, **hardware)
            assert np.isfinite(radio_map.gain_db[radio_map.free]).all()
            play(IrsNavEnv(scene=str(file), cell_size=cell_size, render_mode="ansi", **hardware))

    return target


def play(env: Any) -> None:
    """A few steps."""
    _, info = env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(env.action_space.sample(mask=info["action_mask"]))
    env.render()
    env.close()


# --- maps -----------------------------------------------------------------------------------------

ARRAYS: list[Any] = [
    *(
        np.float64(0.5),
        np.int64(1),
        np.int64(2),
        np.float64("nan"),
        np.zeros(2),
        np.zeros(3),
        np.array("text"),
    ),
    *(np.zeros((0, 3)), np.full((3, 4), np.nan), np.full((3, 4), np.inf), np.full((3, 4), -np.inf)),
    *(
        np.full((3, 4), 1e308),
        np.zeros((4, 3), order="F"),
        np.ones((3, 4), ">f4"),
        np.ones((3, 4), np.longdouble),
    ),
    *(
        np.ones((3, 4), bool),
        np.ones((3, 4), complex),
        np.ones((3, 4), "M8[s]"),
        np.ones((3, 4), [("a", "f8")]),
    ),
    *(np.array([[None]]), np.array([b"bytes"]), np.array(["\ud800"]), np.zeros((1,) * 32)),
]


def packed(
    arrays: dict[str, Any], method: int, headers: list[tuple[int, bytes, bytes]], twice: bool
) -> bytes:
    """An npz archive: of any method, with words of its headers replaced, with an array that is
    there twice.
    """
    content = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(content, "w", method) as archive:
        warnings.simplefilter("ignore")
        for n, (name, array) in enumerate(
            [*arrays.items(), *([("gain_db", np.zeros(3))] if twice else [])]
        ):
            one = io.BytesIO()
            np.save(one, array)
            text = one.getvalue()
            for number, old, new in headers:
                if number % 5 == n:
                    text = text.replace(old, new, 1)
            archive.writestr(f"{name}.npy", text)
    return content.getvalue()


def maps(folder: Path) -> Callable[[], None]:
    """Map files, their environments, and other archives of arrays."""
    from agents.networks.map_network import unpack_network
    from irs_gym import RadioMap
    from irs_gym.datasets.shard import Shard, build_shard, definition_of
    from irs_gym.envs.nav import IrsNavEnv
    from irs_gym.files import read_arrays

    file, definition = folder / "map.npz", definition_of("val", 0, 1)
    block, network = (
        build_shard("val", 0, 1).to_bytes(definition),
        (ROOT / "models" / "planner.npz").read_bytes(),
    )
    gains = st.sampled_from(
        [
            np.zeros((5, 4)),
            np.add.outer(np.arange(5), -np.arange(4.0)),
            np.where(np.eye(5), -np.inf, -60),
        ]
    )
    names = st.sampled_from(["format_version", "gain_db", "cell_size", "origin", "free", "more"])
    forged = st.tuples(
        st.integers(0, 4),
        st.sampled_from(
            [b"(5, 4)", b"<f8", b"False", b"'shape'", b"}", b"NUMPY\x01", b"v\x00", b"()"]
        ),
        st.sampled_from(
            [
                b"(9999999999, 4)",
                b"(0,)",
                b"|O",
                b"|O8",
                b"True",
                b"(" * 90,
                b"",
                b"<f2",
                b"NUMPY\x09",
                b"\xff\xff",
            ]
        ),
    )
    free = st.none() | st.sampled_from(
        [np.ones((5, 4), bool), np.ones((5, 4)), np.zeros((5, 4), bool)]
    )

    @given(
        gains,
        free,
        st.dictionaries(names, st.none() | st.sampled_from(ARRAYS), max_size=2),
        st.sampled_from(
            [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED] * 3 + [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
        ),
        st.just([]) | st.lists(forged, max_size=2),
        st.integers(0, 40).map(lambda n: n == 23),
        st.integers(0, 9).flatmap(lambda n: damages if n in (5, 6) else st.just([])),
        st.sampled_from(["map", "map", "map", "block", "network"]),
    )
    def target(
        gain: Any,
        is_free: Any,
        other: Any,
        method: int,
        headers: Any,
        twice: bool,
        broken: Any,
        kind: str,
    ) -> None:
        if kind in ("block", "network"):
            content = damaged({"block": block, "network": network}[kind], broken)
        else:
            arrays = {
                "format_version": np.int64(1),
                "gain_db": gain,
                "cell_size": np.float64(0.5),
                "origin": np.zeros(2),
            }
            arrays |= {} if is_free is None else {"free": is_free}
            arrays = {name: array for name, array in (arrays | other).items() if array is not None}
            content = damaged(packed(arrays, method, headers, twice), broken)
        file.write_bytes(content)
        with judged():
            read_arrays(file)
            if kind == "block":
                Shard.from_bytes(content, definition)
            elif kind == "network":
                unpack_network(content)
            else:
                RadioMap.load(file)
                task = {"radio_map": str(file), "start": (0, 1), "goal": (3, 2), "target_db": -90.0}
                play(IrsNavEnv(**task, constraint="allow", render_mode="ansi"))

    return target


# --- arguments ------------------------------------------------------------------------------------


def arguments(folder: Path) -> Callable[[], None]:
    """Arguments of the public functions and of the environments."""
    import irs_gym
    from irs_gym.datasets import scene_set
    from irs_gym.datasets.random_task import RandomTask
    from irs_gym.envs.nav import IrsNavEnv
    from irs_gym.envs.random_nav import IrsNavRandomEnv
    from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
    from irs_gym.envs.vector_nav import IrsNavVectorEnv
    from irs_gym.mdp.task import Task

    gain = irs_gym.build_radio_map("paper", 2.0).gain_db
    os.mkfifo(folder / "fifo")
    feasible = np.isfinite(gain)
    arrays: list[Any] = [
        *(gain, feasible, gain.tolist(), np.zeros((3, 3), int)),
        *(
            np.full((4, 4), np.nan),
            np.full((4, 4), np.inf),
            np.full((4, 4), -np.inf),
            np.zeros((0, 0)),
            np.zeros(3),
        ),
        *(
            np.broadcast_to(True, (10**6, 10**6)),
            np.broadcast_to(0.0, (10**5, 10**5)),
            np.array([["a"]]),
        ),
        *(
            np.ones((2, 2), complex),
            np.array([[None]]),
            1e300 * np.ones((3, 3)),
            np.ones((2, 2), "M8[s]"),
        ),
    ]
    cells: list[Any] = [
        (0, 4),
        (9, 4),
        (0.5, 20),
        (True, False),
        ("0", "1"),
        (-1, 0),
        (10**30, 0),
        (0,),
        None,
        "ab",
    ]
    paths: list[Any] = [
        str(folder),
        str(folder / "fifo"),
        "/dev/zero",
        "/dev/null",
        "a\0",
        "a" * 5000,
        0,
        1,
        5,
        True,
        b"x",
    ]
    anything = st.sampled_from(
        [*NASTY, *arrays, *cells, *paths, np.float32(0.5), np.int64(3), np.bool_(True), object()]
    )
    number = st.sampled_from([0.5, 1.0, 2.0]) | anything
    cell, array = (
        st.sampled_from(cells[:2]) | st.sampled_from(cells) | anything,
        st.sampled_from(arrays[:2]) | anything,
    )
    cells_of = st.lists(st.sampled_from(cells), max_size=2) | anything
    stack = st.sampled_from([np.zeros((2, 4, 4)), np.stack([gain] * 3), gain[None]]) | anything
    paper, none, size = st.just("paper") | anything, st.none() | anything, st.just(3) | anything
    target, coarse = st.just(-61.8) | anything, st.just(2.0) | anything
    beams = irs_gym.dft_codebook("paper", 2)
    functions: list[tuple[Callable[..., Any], list[Any]]] = [
        (irs_gym.shortest_path, [array, cell, cell, number]),
        (irs_gym.distance_to_go, [array, cell, number]),
        (irs_gym.highest_feasible_target, [array, cell, cell]),
        (irs_gym.trade_off, [array, cell, cell, number]),
        (irs_gym.pareto_front, [array, cell, cell, number]),
        (irs_gym.budget_to_go, [array, cell, number, number]),
        (irs_gym.straight_line_bound, [array, cell, cell, number]),
        (irs_gym.shortest_lengths, [array, cells_of, cells_of, number]),
        (lambda *parts: irs_gym.Robot(**dict(zip(ROBOT, parts, strict=True))), [anything] * 3),
        (irs_gym.RadioMap.from_array, [array, number, anything, st.none() | anything]),
        (irs_gym.RadioMap.load, [anything]),
        (irs_gym.load_scene, [anything]),
        (irs_gym.from_sionna, [anything]),
        (irs_gym.Grid, [cell, number, st.just((0, 0)) | anything]),
        (irs_gym.Grid.tile, [st.just((0, 0)) | anything, st.just((4, 4)) | anything, number]),
        (irs_gym.Grid((4, 4), 1.0, (0.0, 0.0)).cell_of, [st.just((1, 1)) | anything]),
        (
            irs_gym.generate_scene,
            [st.just(np.random.default_rng(0)) | anything, st.just("easy") | anything],
        ),
        (
            irs_gym.build_radio_map,
            [st.just("paper") | anything, number, st.none() | anything, st.none() | anything],
        ),
        (
            irs_gym.build_phase_shifts,
            [st.just("paper") | anything, number, st.none() | anything, st.none() | anything],
        ),
        (scene_set.build_scene_set, [st.just("val") | anything, st.just(0) | anything]),
        (irs_gym.joint_shortest_path, [stack, number, cell, cell, number, number, none]),
        (irs_gym.joint_distance_to_go, [stack, number, cell, number, number]),
        (irs_gym.highest_joint_target, [stack, cell, cell]),
        (irs_gym.switch_front, [stack, number, cell, cell, number]),
        (irs_gym.Codebook, [array, st.just("0" * 64) | anything, anything]),
        (irs_gym.Codebook.from_array, [array, paper, none]),
        (irs_gym.Codebook.load, [anything]),
        (irs_gym.codebook_gain_db, [paper, st.just(beams) | anything, number, none]),
        (irs_gym.dft_codebook, [paper, size, none, none, anything]),
        (irs_gym.focused_codebook, [paper, st.lists(cell, max_size=2) | anything, number, none]),
        (irs_gym.cover_codebook, [paper, size, target, coarse, none, none]),
        (irs_gym.fewest_configurations, [paper, target, coarse, none, none]),
    ]
    names = [name for kind in (Task, RandomTask) for name in kind.__dataclass_fields__]
    given_names = st.sampled_from(
        [*names, "num_envs", "max_episode_steps", "autoreset_mode", "render_mode", "nothing"]
    )
    kwargs = st.dictionaries(given_names, anything, min_size=1, max_size=2)

    @st.composite
    def calls(draw: Any) -> tuple[Callable[..., Any], list[Any]]:
        function, parts = draw(st.sampled_from(functions))
        return function, [draw(part) for part in parts]

    made: list[Callable[..., Any]] = [
        lambda **more: play(IrsNavEnv(**{"cell_size": 2.0} | more)),
        lambda **more: play(IrsNavRandomEnv(**{"num_scenes": 2, "split": "val"} | more)),
        lambda **more: IrsNavVectorEnv(**{"num_envs": 2, "cell_size": 2.0} | more).reset(seed=0),
        lambda **more: IrsNavRandomVectorEnv(
            **{"num_envs": 2, "num_scenes": 2, "split": "val"} | more
        ).reset(seed=0),
    ]

    @given(calls() | st.tuples(st.sampled_from(made), kwargs))
    def target(call: tuple[Callable[..., Any], Any]) -> None:
        function, given_arguments = call
        if isinstance(given_arguments, dict):
            count = given_arguments.get("num_scenes", 0)
        else:
            count = given_arguments[1] if function is scene_set.build_scene_set else 0
            count = 1000 if count is None else count
        is_count = isinstance(count, int | float | np.number)
        assume(not is_count or not 8 < count <= 10**6)  # so many are built, which takes long
        with judged():
            if isinstance(given_arguments, dict):
                function(**given_arguments)
            else:
                function(*given_arguments)

    return target


# --- floor plans ----------------------------------------------------------------------------------


def plans(folder: Path) -> Callable[[], None]:
    """Floor plans of all kinds, and the scenes that are made of them."""
    from irs_gym.convert import main
    from irs_gym.radio.scene import load_scene

    square = [[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]
    inner = [[2, 2], [3, 2], [3, 3], [2, 3], [2, 2]]
    features = [
        {
            "type": "Feature",
            "properties": properties,
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for ring, properties in ((square, {"room": True}), (inner, {"height": 1.5}))
    ]
    pixels = np.full((8, 12), 254, dtype=np.uint8)
    pixels[0] = pixels[3, 4:] = 0
    picture = io.BytesIO()
    Image.fromarray(pixels).save(picture, "PNG")
    rows = "\n".join("".join("@" if pixel == 0 else "." for pixel in row) for row in pixels)
    files: dict[str, bytes] = {
        "plan.geojson": as_json({"type": "FeatureCollection", "features": features}),
        "plan.yaml": b"image: plan.pgm\nresolution: 0.5\norigin: [-1.0, 0.0, 0.0]\nnegate: 0\n"
        b"occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        "plan.pgm": b"P5\n12 8\n255\n" + pixels.tobytes(),
        "plan.png": picture.getvalue(),
        "plan.map": f"type octile\nheight 8\nwidth 12\nmap\n{rows}\n".encode(),
        "plan.map.scen": b"version 1\n0\tplan.map\t12\t8\t0\t7\t11\t1\t13.4853\n",
    }
    given_files = st.sampled_from(list(files))
    words = st.sampled_from(
        [[], ["--metres-per-pixel", "0.5"], ["--height", "2"], ["--unit", "deg"]]
    )
    tree = json.loads(files["plan.geojson"])

    @given(given_files, given_files, damages, changes, words)
    def target(read: str, broken: str, wanted: Any, wanted_of_tree: Any, more: list[str]) -> None:
        for name, content in files.items():
            (folder / name).write_bytes(damaged(content, wanted) if name == broken else content)
        if broken == "plan.geojson":
            (folder / broken).write_bytes(damaged(as_json(mutated(tree, wanted_of_tree)), wanted))

        out = folder / "out.json"
        line = [str(folder / read), str(out), "--access-point", "1", "1", "2", *more]
        said = io.StringIO()
        with judged(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if main(line) == 0:
                load_scene(out)
        assert "Traceback" not in said.getvalue()

    return target


# --- submissions ----------------------------------------------------------------------------------


def submissions(folder: Path) -> Callable[[], None]:
    """Submissions to the leaderboard, plain and packed: what is taken is what was done."""
    from eval.leaderboard.replay import submission_of, verify
    from eval.leaderboard.submission import Agent, load
    from eval.leaderboard.track import TRACKS

    track = TRACKS["paper-61.8dB-continuous"]
    env = track.make_env(observation="cell")
    env.reset()
    inner: Any = env.unwrapped
    way = []
    while inner.distance_to_go > 0:
        way.append(int(inner.optimal_actions()[0]))
        env.step(way[-1])

    agent = Agent(name="oracle", authors="We", version="1", commit=None)
    valid = submission_of(track, [way], agent)
    tree = json.loads(valid.model_dump_json())
    letters = st.text("01234567abcdefgh89x", max_size=3)

    @given(changes, damages, st.integers(0, 60), letters, st.booleans())
    def target(wanted: Any, broken: Any, step: int, more: str, is_packed: bool) -> None:
        changed = copy.deepcopy(tree)
        actions = changed["episodes"][0]["actions"]
        changed["episodes"][0]["actions"] = actions[:step] + more + actions[step + len(more) :]
        content = damaged(as_json(mutated(changed, wanted)), broken)
        file = folder / "submission.json"
        file.write_bytes(gzip.compress(content) if is_packed else content)

        with judged():
            found = verify(load(file))
            (outcome,) = found.outcomes
            (claimed,) = found.submission.episodes
            assert (outcome.is_success, outcome.distance) == (claimed.is_success, claimed.distance)
            assert found.submission.scores == found.scores

    return target


# --- run folders ----------------------------------------------------------------------------------


def runs(folder: Path) -> Callable[[], None]:
    """Run folders, as the scoreboard and ``train --resume`` read them."""
    from hashlib import sha256

    from tiny import TINY, call, open_floor

    from agents.runs.run_folder import Run
    from eval.scoreboard.results import find_runs, read_results
    from train.config import settings_of
    from train.run import check

    bases, floor = [], open_floor(folder)
    for algorithm, more in (("q_learning", []), ("q_learning", ["--hold", "9"]), ("ppo", [])):
        base = folder / f"{algorithm}{len(bases)}"
        assert (
            call(
                [
                    algorithm,
                    "--out",
                    base,
                    *TINY[algorithm],
                    *floor,
                    "--agent.total-timesteps",
                    128,
                    *more,
                ]
            )
            == 0
        )
        bases.append({each.name: each.read_bytes() for each in base.iterdir() if each.is_file()})
    place = folder / "fuzzed" / "run"

    @given(
        st.sampled_from(bases),
        st.just([]) | changes,
        st.just([]) | changes,
        st.none()
        | st.tuples(
            st.integers(0, 20),
            st.sampled_from(["damage", "drop", "folder", "link", "fifo"]),
            damages,
        ),
        st.booleans(),
    )
    def target(
        base: dict[str, bytes], manifest: Any, config: Any, one: Any, is_rehashed: bool
    ) -> None:
        shutil.rmtree(place.parent, ignore_errors=True)
        place.mkdir(parents=True)
        files = dict(base)
        for name, wanted in (("manifest.json", manifest), ("config.json", config)):
            files[name] = (
                as_json(mutated(json.loads(files[name]), wanted)) if wanted else files[name]
            )
        name, how, broken = (
            (None, "", []) if one is None else (sorted(files)[one[0] % len(files)], *one[1:])
        )
        if how == "damage":
            files[name] = damaged(files[name], broken)
        for each in base if is_rehashed else ():
            if not each.endswith((".zip", ".pickle")):  # to read what is pickled runs it
                digests = (
                    sha256(base[each]).hexdigest().encode(),
                    sha256(files[each]).hexdigest().encode(),
                )
                files["manifest.json"] = files["manifest.json"].replace(*digests)
        for each, content in files.items():
            (place / each).write_bytes(content)
        if how in ("drop", "folder", "link", "fifo"):
            (place / name).unlink()
            make = {
                "folder": Path.mkdir,
                "fifo": os.mkfifo,
                "link": lambda path: path.symlink_to("/dev/zero"),
            }
            make.get(how, lambda _: None)(place / name)
        with judged():
            read_results(find_runs(place.parent))
        with judged():
            run = Run.open(place)
            settings_of(run)
        with judged():
            Run.open(place).load_model()
        with judged():
            from train.config import parse

            check(parse("q_learning", ["--resume", str(place)]))

    return target


# --- command lines --------------------------------------------------------------------------------

WORDS = [
    *(
        "",
        "0",
        "-1",
        "1",
        "3",
        "64",
        "0.5",
        "1e-3",
        "1e9",
        "1e400",
        "nan",
        "inf",
        "-inf",
        "None",
        "True",
        "10" * 300,
    ),
    *(
        "paper",
        "workshop",
        "default",
        "flat",
        "map",
        "best",
        "train",
        "val",
        "é",
        "a\0b",
        "/dev/zero",
        "/nowhere/x",
        ".",
    ),
    *(
        "--",
        "-",
        "=",
        "[]",
        "{}",
        "(0, 0)",
        "best last",
        "\ud800",
        "$(id)",
        "--help",
        "ppo",
        "oracle",
        "models",
    ),
]


def commands(folder: Path) -> Callable[[], None]:
    """Command lines of ``train`` and ``eval``: read and checked, not run."""
    import tyro

    from agents.registry import ALGORITHMS
    from eval.__main__ import COMMANDS
    from train.config import defaults_of, parse, record_of
    from train.run import check

    os.chdir(folder)
    trainable = ["q_learning", "ppo", "dqn", *ALGORITHMS]
    mains = {name: import_module(f"eval.commands.{name}").main for name in COMMANDS}

    def options_of(config: Any, prefix: str = "--") -> list[str]:
        found = []
        for name, value in vars(config).items():
            is_part = hasattr(value, "__dataclass_fields__")
            found += (
                options_of(value, f"{prefix}{name}.")
                if is_part
                else [f"{prefix}{name}".replace("_", "-")]
            )
        return found

    def train_lines(algorithm: str) -> st.SearchStrategy[Any]:
        option = st.sampled_from(options_of(defaults_of(algorithm)))
        pair = st.tuples(
            option, st.sampled_from(WORDS) | st.text(max_size=4) | st.integers().map(str)
        )
        return st.tuples(st.just(algorithm), st.lists(pair, min_size=1, max_size=2))

    def eval_lines(command: str) -> st.SearchStrategy[Any]:
        names = [
            f"--{name.replace('_', '-')}"
            for name in mains[command].__annotations__
            if name != "return"
        ]
        word = st.sampled_from([*WORDS, *names])
        return st.tuples(st.just(command), st.lists(st.tuples(word, word), max_size=3))

    lines = {
        **{f"train {each}": train_lines(each) for each in dict.fromkeys(trainable)},
        **{f"eval {each}": eval_lines(each) for each in COMMANDS},
    }

    @given(
        st.sampled_from(list(lines)).flatmap(lambda which: st.tuples(st.just(which), lines[which]))
    )
    def target(drawn: Any) -> None:
        which, (name, pairs) = drawn
        words = [word for pair in pairs for word in pair]
        said = io.StringIO()
        with judged(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            try:
                if which.startswith("train"):
                    config = parse(name, words)
                    check(config)
                    record_of(config)
                else:
                    read = functools.wraps(mains[name])(lambda *_, **__: 0)
                    tyro.cli(read, args=words, prog=name)
            except SystemExit as ended:
                if ended.code not in (0, 2):
                    raise AssertionError(f"exit status {ended.code}") from ended
        assert "Traceback" not in said.getvalue()

    return target


# --- all of them ----------------------------------------------------------------------------------

TARGETS: dict[str, Callable[[Path], Callable[[], None]]] = {
    "scenes": scenes,
    "maps": maps,
    "plans": plans,
    "arguments": arguments,
    "submissions": submissions,
    "runs": runs,
    "commands": commands,
}


def fuzz(name: str, inputs: int, number: int | None) -> None:
    """Give one target so many inputs; ends with the traceback of the smallest one that fails."""
    os.environ["IRS_GYM_MEMORY"] = MEMORY
    with tempfile.TemporaryDirectory() as folder:
        os.environ["IRS_GYM_CACHE"] = str(Path(folder) / "cache")
        target = TARGETS[name](Path(folder))
        held = (
            int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            if sys.platform == "linux"
            else 0
        )
        if held:
            resource.setrlimit(resource.RLIMIT_AS, (held + BYTES, resource.RLIM_INFINITY))
        how = settings(
            max_examples=inputs,
            deadline=None,
            database=None,
            derandomize=number is None,
            suppress_health_check=list(HealthCheck),
        )
        target = how(target)
        (target if number is None else seed(number)(target))()
        os.chdir(ROOT)
    counts = ", ".join(f"{how} {count} times" for how, count in COUNTS.items())
    print(f"{name}: {inputs} inputs, all in good order: {counts}")


def main() -> int:
    """Fuzz all targets at once, each in a process of its own, or the one that is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="*", choices=[*TARGETS, []], help="all by default")
    parser.add_argument("--inputs", type=int, default=2000, help="for each target (2000)")
    parser.add_argument(
        "--seed", type=int, default=None, help="other inputs than those of every time"
    )
    options = parser.parse_args()
    if len(options.targets) == 1:
        fuzz(options.targets[0], options.inputs, options.seed)
        return 0

    more = [] if options.seed is None else ["--seed", str(options.seed)]
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")]),
    }
    status, waiting, running = 0, list(options.targets or TARGETS), []
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            words = [
                sys.executable,
                __file__,
                waiting.pop(0),
                "--inputs",
                str(options.inputs),
                *more,
            ]
            running.append(subprocess.Popen(words, cwd=ROOT, env=environment))
        ended = running.pop(0)
        status |= bool(ended.wait())
    return status


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    sys.exit(main())
