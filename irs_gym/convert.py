"""`python -m irs_gym.convert IN OUT.json`: a scene file from a floor plan."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from irs_gym.radio.readers.floor_plan import CEILING, FloorPlan
from irs_gym.radio.readers.geojson import read_geojson
from irs_gym.radio.readers.movingai import map_of, plan_of_map, read_movingai_map
from irs_gym.radio.readers.movingai import read_movingai_scenarios as read_scenarios
from irs_gym.radio.readers.picture import read_picture
from irs_gym.radio.readers.ros_map import read_ros_map
from irs_gym.radio.scene import load_scene

Read = Callable[..., FloorPlan]


def main(arguments: Sequence[str] | None = None) -> int:
    """Read a plan, by what its name ends in, and write what a scene file holds; returns the exit
    status.
    """
    given = vars(_parser().parse_args(arguments))
    plan: Path = given.pop("plan")
    out: Path = given.pop("out")

    try:
        read = _reader(plan)
        parts = {name: given.pop(name) for name in _PARTS if name in given}
        foreign = [_option(name) for name in given if name not in _ARGUMENTS[read]]
        if foreign:
            raise ValueError(f"{', '.join(foreign)} is not for {plan.name}")
        if read is read_picture and "metres_per_pixel" not in given:
            raise ValueError(f"{plan}: a picture needs {_option('metres_per_pixel')}")

        _write(read(plan, **given), parts, out)
    except (OSError, ValueError) as error:
        print(f"python -m irs_gym.convert: {error}", file=sys.stderr)
        return 2

    return 0


def read_scenario(
    path: Path, scenario: int = 0, cell_size: float = 1.0, height: float = CEILING
) -> FloorPlan:
    """Floor plan of a task of the MovingAI benchmarks: the map beside its file, start and goal.

    Raises
    ------
    FileNotFoundError
        Where there is no such file or map.
    ValueError
        Where one is damaged, or there is no scenario of that number.
    """
    scenarios = read_scenarios(path)
    if not 0 <= scenario < len(scenarios):
        raise ValueError(f"{path}: scenario={scenario} must be from 0 to {len(scenarios) - 1}")

    return plan_of_map(path.stem, map_of(path, scenarios), cell_size, height, scenarios[scenario])


# What a name may end in, and which of the options each reader takes.
_READERS: dict[Read, tuple[str, ...]] = {
    read_ros_map: (".yaml", ".yml"),
    read_movingai_map: (".map",),
    read_scenario: (".scen",),
    read_geojson: (".geojson", ".json"),
    read_picture: (".png", ".pgm", ".jpg", ".jpeg", ".bmp", ".gif", ".tif", ".tiff"),
}
_ARGUMENTS: dict[Read, tuple[str, ...]] = {
    read_ros_map: ("height", "unknown_is_free"),
    read_movingai_map: ("height", "cell_size"),
    read_scenario: ("height", "cell_size", "scenario"),
    read_geojson: ("height", "unit"),
    read_picture: ("height", "metres_per_pixel", "threshold"),
}
# Options that are fields of the scene.
_PARTS = ("name", "start", "goal", "target_db", "access_points", "irs_panels")


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _reader(plan: Path) -> Read:
    ending = plan.suffix.lower()
    for read, endings in _READERS.items():
        if ending in endings:
            return read

    known = ", ".join(each for endings in _READERS.values() for each in endings)
    raise ValueError(f"{plan}: a plan's name must end in one of {known}")


def _write(plan: FloorPlan, parts: dict[str, Any], out: Path) -> None:
    """Write the whole scene where there is an access point, and what there is otherwise."""
    if "access_points" in parts:
        scene = plan.scene(**{"irs_panels": [], **parts})
        scene.save(out)
        print(f"written: {out}")
        return

    FloorPlan({**plan.data, **parts}).save(out)
    missing = [field for field in ("access_points", "irs_panels") if field not in parts]
    print(f"written: {out}, to which {' and '.join(missing)} must be added by hand or by options")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m irs_gym.convert",
        description=(
            "Write a scene file from a floor plan: map.yaml of ROS's map_server, .map or .scen of "
            "MovingAI, GeoJSON polygons, or a picture on which walls are dark."
        ),
        argument_default=argparse.SUPPRESS,
    )
    parser.add_argument("plan", type=Path, metavar="IN")
    parser.add_argument("out", type=Path, metavar="OUT.json")

    how = parser.add_argument_group("how the plan is read")
    add = how.add_argument
    add("--height", type=float, help=f"metres, of the ceiling and of walls; {CEILING} by default")
    add("--metres-per-pixel", type=float, help="of a picture")
    add("--threshold", type=float, help="of a picture: darker is blocked; 0.5 by default")
    add("--cell-size", type=float, help="metres, of a cell of a MovingAI map; 1 by default")
    add("--scenario", type=int, help="number of the task in a .scen file; the first by default")
    add("--unit", choices=("m", "deg"), help="of GeoJSON coordinates; m by default")
    add("--unknown-is-free", action="store_true", help="of cells that a ROS map knows nothing of")

    what = parser.add_argument_group("what no plan tells, in metres")
    add = what.add_argument
    add("--name")
    add("--start", type=float, nargs=2, metavar=("X", "Y"))
    add("--goal", type=float, nargs=2, metavar=("X", "Y"))
    add("--target-db", type=float)
    add(
        "--access-point",
        dest="access_points",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        action=_AccessPoint,
        help="once for each",
    )
    add(
        "--irs-panel",
        dest="irs_panels",
        nargs=4,
        metavar=("X", "Y", "Z", "WALL"),
        action=_Panel,
        help=(
            "one like the paper's, on the wall x_min, x_max, y_min or y_max, or on one that runs "
            "at so many degrees against the x axis; once for each"
        ),
    )

    return parser


class _AccessPoint(argparse.Action):
    """Adds an access point to those that were given before."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        before = getattr(namespace, self.dest, [])
        setattr(namespace, self.dest, [*before, {"position": values}])


class _Panel(argparse.Action):
    """Adds a panel of the paper's size to those that were given before."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        before = getattr(namespace, self.dest, [])
        *position, wall = values

        try:
            where = [float(each) for each in position]
        except ValueError:
            parser.error(f"argument {option}: {position} must be three numbers of metres")

        is_named = wall in ("x_min", "x_max", "y_min", "y_max")
        try:
            side = wall if is_named else float(wall)
        except ValueError:
            parser.error(f"argument {option}: wall {wall!r} must be a name or an angle")

        paper = load_scene("paper").to_data()["irs_panels"][0]
        panel = {**paper, "position": where, "wall": side}
        setattr(namespace, self.dest, [*before, panel])


if __name__ == "__main__":
    sys.exit(main())
