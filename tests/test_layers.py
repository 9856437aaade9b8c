"""Facts of the plan of the packages: no import circle, at most seven floors, contracts of a handful
of rows.

Imports inside functions count, as do those for type checkers. A floor is a row of siblings: the
modules and packages right below one package, each on what is below it.
"""

import tomllib
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("irs_gym", "agents", "train", "eval")
HANDFUL = 7

Arrows = dict[str, set[str]]


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(*PACKAGES, cache_dir=None)


@pytest.fixture
def house(tmp_path, monkeypatch):
    """Build the graph of a package `house` of two modules, `door` and `wall`, from their texts."""

    def build(door: str, wall: str) -> grimp.ImportGraph:
        (tmp_path / "house").mkdir()
        for name, text in (("__init__", ""), ("door", door), ("wall", wall)):
            (tmp_path / "house" / f"{name}.py").write_text(text)

        monkeypatch.syspath_prepend(tmp_path)
        return grimp.build_graph("house", cache_dir=None)

    return build


def module_arrows(graph: grimp.ImportGraph, package: str) -> Arrows:
    """What each module below a package imports of the others."""
    inside = graph.find_descendants(package)
    return {name: graph.find_modules_directly_imported_by(name) & inside for name in inside}


def sibling_arrows(graph: grimp.ImportGraph, package: str) -> Arrows:
    """What each child of a package imports of the others, with all that is below it."""
    depth = package.count(".") + 2
    found: Arrows = {child: set() for child in graph.find_children(package)}

    for name, imported in module_arrows(graph, package).items():
        child = ".".join(name.split(".")[:depth])
        found[child] |= {".".join(each.split(".")[:depth]) for each in imported} - {child}

    return found


def floors_of(arrows: Arrows) -> int:
    """Number of floors; raises `graphlib.CycleError` for a circle, and names it."""
    heights: dict[str, int] = {}

    for name in TopologicalSorter(arrows).static_order():
        heights[name] = 1 + max((heights[each] for each in arrows[name]), default=0)

    return max(heights.values())


@pytest.mark.parametrize("package", PACKAGES)
def test_no_modules_import_each_other_in_a_circle(graph, package):
    assert floors_of(module_arrows(graph, package))


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_has_a_circle_or_more_than_seven_floors(graph, package):
    packages = {each for each in graph.modules if graph.find_children(each)}
    own = {each for each in packages if each == package or each.startswith(f"{package}.")}
    floors = {each: floors_of(sibling_arrows(graph, each)) for each in sorted(own)}
    assert {each: number for each, number in floors.items() if number > HANDFUL} == {}


def test_a_circle_through_an_import_inside_a_function_is_seen(house):
    graph = house("def open():\n    from house import wall\n", "import house.door\n")
    with pytest.raises(CycleError, match=r"house\.door"):
        floors_of(module_arrows(graph, "house"))
    with pytest.raises(CycleError, match=r"house\.door"):
        floors_of(sibling_arrows(graph, "house"))


def test_floors_are_counted_through_imports_inside_functions(house):
    graph = house("def open():\n    from house import wall\n", "")
    assert floors_of(module_arrows(graph, "house")) == 2


def test_every_package_has_a_contract_of_a_handful_of_rows():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = [each for each in settings["contracts"] if each["type"] == "layers"]
    assert [each.get("containers") for each in layers] == [None, *([name] for name in PACKAGES)]
    assert max(len(each["layers"]) for each in layers) <= HANDFUL
    assert all(each["exhaustive"] for each in layers[1:])
    assert settings["root_packages"] == list(PACKAGES)
