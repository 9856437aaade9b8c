"""Facts of `python -m eval paper`: what it computes, what it writes, and when it fails."""

import csv
import json
from itertools import product
from math import inf
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from PIL import Image

from eval.commands import paper
from eval.paper import monte_carlo, scaling
from eval.paper.beyond_sections import (
    cost_promises,
    cost_section,
    distinct_gains,
    trade_off_section,
)
from eval.paper.claim import Claim, number
from eval.paper.curve_figures import draw_distance_over_target
from eval.paper.distance_claims import excess, extra_elements, lost_db
from eval.paper.map_claims import model_claims
from eval.paper.map_figures import draw_gain_maps, draw_scene
from eval.paper.scaling import ScalingCost
from eval.paper.sections import claims_section, open_choices_section
from eval.paper.segments import dips_of_map, dips_of_path
from eval.paper.study import CONTINUOUS, ONE_BIT, SCHEMES, THREE_BIT, TWO_BIT, WITHOUT, Study
from irs_gym import TradeOff, load_scene

DOCS = Path(__file__).parents[2] / "docs"
FIGURES = [
    *("scene", "gain_maps", "paths", "distance_over_target", "distance_over_elements"),
    *("monte_carlo", "optimal_quantiser", "cost_of_grid", "workshop"),
]
STUDY = Study(load_scene("paper"))


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """A folder into which the command has written."""
    out = tmp_path_factory.mktemp("docs")
    assert paper.main(out=out, cost=False, draws=1000) == 0
    return out


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


# --- what is written ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_is_a_picture_a_drawing_and_its_data(written, name):
    with Image.open(written / "figures" / f"{name}.png") as picture:
        assert (
            len(np.unique(np.asarray(picture.convert("L")))) > 10
        )  # something is drawn, and not in one grey
    assert (written / "figures" / f"{name}.svg").read_text(encoding="utf-8").count("<path") > 10
    assert rows_of(written / "figures" / f"{name}.csv")
    assert f"figures/{name}.png" in (written / "paper.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "monte_carlo"])
def test_the_committed_data_are_those_that_the_command_computes(written, name):
    committed, fresh = (rows_of(folder / "figures" / f"{name}.csv") for folder in (DOCS, written))
    assert len(committed) == len(fresh)
    for one, other in zip(committed, fresh, strict=True):
        assert one.keys() == other.keys()
        for key in one:
            try:
                assert float(one[key]) == pytest.approx(float(other[key]), abs=1e-6)
            except ValueError:
                assert one[key] == other[key]


def test_the_committed_page_tells_the_claims_as_they_are_computed():
    claims = [claim for part in paper.PARTS for claim in part(STUDY)]
    assert claims_section(claims).strip() in (DOCS / "paper.md").read_text(encoding="utf-8")


def test_the_data_of_the_figures_are_the_maps_paths_and_curves(written):
    without, with_irs = STUDY.radio_map(WITHOUT).gain_db, STUDY.radio_map(CONTINUOUS).gain_db
    for row in rows_of(written / "figures" / "gain_maps.csv"):
        cell = int(row["i"]), int(row["j"])
        assert float(row["without_irs_db"]) == pytest.approx(without[cell], abs=1e-6)
        assert float(row["with_irs_db"]) == pytest.approx(with_irs[cell], abs=1e-6)
    for row in rows_of(written / "figures" / "distance_over_elements.csv"):
        scheme = next(each for each in SCHEMES if each.name == row["scheme"])
        assert float(row["distance_m"]) == pytest.approx(
            STUDY.distance(scheme, -61.8, elements=int(row["elements"])), abs=1e-6
        )
    for scheme in (WITHOUT, ONE_BIT, CONTINUOUS):
        rows = [
            row
            for row in rows_of(written / "figures" / "paths.csv")
            if row["scheme"] == scheme.name
        ]
        points = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert length == pytest.approx(STUDY.distance(scheme, -63.0), abs=1e-6)


@pytest.mark.parametrize(
    ("draw", "name"),
    [
        (draw_scene, "scene"),
        (draw_gain_maps, "gain_maps"),
        (draw_distance_over_target, "distance_over_target"),
    ],
)
def test_figures_of_the_same_data_are_the_same_files(written, tmp_path, draw, name):
    draw(STUDY, tmp_path)
    for file in (f"{name}.png", f"{name}.svg", f"{name}.csv"):
        assert (tmp_path / file).read_bytes() == (written / "figures" / file).read_bytes()


# --- when it fails --------------------------------------------------------------------------------


def test_a_scene_in_which_the_papers_numbers_do_not_hold_fails(tmp_path, capsys):
    scene = STUDY.scene
    moved = scene.access_points[0].model_copy(update={"position": (1.0, 10.0, 2.0)})
    scene.model_copy(update={"name": "moved", "access_points": (moved,)}).save(
        tmp_path / "moved.json"
    )
    assert (
        paper.main(
            scene=str(tmp_path / "moved.json"), out=tmp_path / "docs", cost=False, draws=1000
        )
        == 1
    )
    page = (tmp_path / "docs" / "paper.md").read_text(encoding="utf-8")
    assert "NOT MET" in page
    assert "are not" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scene": "workshop"}, "2 access points and 2 panels, not 1 and 1"),
        ({"scene": "ward"}, "format_version 2"),
        ({"scene": "nowhere.json"}, "nowhere.json"),
        ({"draws": 10}, "draws=10 must be 1000 or more"),
    ],
)
def test_what_it_cannot_judge_is_refused_before_anything_is_written(
    tmp_path, capsys, arguments, message
):
    assert paper.main(out=tmp_path / "docs", cost=False, **arguments) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


def test_packages_that_are_missing_are_named_before_any_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(paper, "find_spec", lambda name: None if name == "networkx" else object())
    assert paper.main(out=tmp_path / "docs") == 2
    assert 'networkx not installed: pip install -e ".[train,test]"' in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


def test_only_a_broken_promise_fails():
    kept = number("kept", 1.0, 1.04, " dB", 2, 0.05)
    open_question = number("open", 1.0, 2.0, " dB", 2, 0.05, is_promised=False)
    broken = number("broken", 1.0, 2.0, " dB", 2, 0.05)
    assert [claim.verdict for claim in (kept, open_question, broken)] == [
        "met",
        "not met, see note",
        "NOT MET",
    ]
    assert paper.report([kept, open_question], []) == 0
    assert paper.report([kept, broken], []) == 1
    assert number("infeasible", 1.0, -inf, " dB", 2, 0.05) == Claim(
        "infeasible", "1 dB", ("infeasible",), "", False, True
    )


# --- what is compared -----------------------------------------------------------------------------


def random_curve(seed: int) -> TradeOff:
    rng = np.random.default_rng(seed)
    steps = int(rng.integers(1, 6))
    return TradeOff(np.sort(rng.uniform(-10, 0, steps)), np.sort(rng.uniform(20, 30, steps)), 0)


@pytest.mark.parametrize("seed", range(20))
def test_excess_is_the_largest_ratio_of_a_fine_sweep(seed):
    longer, shorter = random_curve(seed), random_curve(seed + 100)
    targets = np.linspace(-9, -1, 80001)
    reached = np.isfinite(shorter.distance_at(targets))
    if reached.any():
        swept = 100 * np.max(
            longer.distance_at(targets)[reached] / shorter.distance_at(targets)[reached] - 1
        )
        assert excess(longer, shorter, -9, -1) == pytest.approx(swept, rel=1e-12)


def test_lost_db_is_how_far_a_curve_lies_to_the_left():
    fine = TradeOff(np.array([-3.0, -2.0, -1.0]), np.array([20.0, 21.0, 22.0]), 0)
    coarse = TradeOff(np.array([-3.5, -1.2]), np.array([20.0, 21.5]), 0)
    assert lost_db(coarse, fine) == pytest.approx(1.5)  # at 21 m: -2 against -3.5
    assert lost_db(fine, fine) == 0
    assert lost_db(TradeOff(np.array([-3.0]), np.array([25.0]), 0), fine) == inf


def test_extra_elements_are_those_of_all_pairs_of_schemes_and_numbers():
    counts, expected = range(200, 3601, 200), 0
    for scheme, m in product((TWO_BIT, THREE_BIT, CONTINUOUS), counts):
        length = STUDY.distance(scheme, -61.8, elements=m)
        fewest = min(
            n for n in counts if STUDY.distance(scheme, -61.8, elements=n) <= length + 1e-9
        )
        needed = min(
            n for n in counts if STUDY.distance(ONE_BIT, -61.8, elements=n) <= length + 1e-9
        )
        expected = max(expected, needed - fewest)
    assert (
        extra_elements(STUDY, ONE_BIT, [TWO_BIT, THREE_BIT, CONTINUOUS], "nearest")
        == expected
        == 600
    )


def test_a_panel_of_flat_sub_surfaces_needs_1400_more_elements_beyond_the_axis_of_the_figure():
    panel = STUDY.scene.irs_panels[0].model_copy(update={"elements_per_subsurface": (10, 2)})
    flat = Study(STUDY.scene.model_copy(update={"irs_panels": (panel,)}))
    assert flat.distance(CONTINUOUS, -61.8, elements=2400) == pytest.approx(21.571, abs=5e-4)
    assert flat.distance(ONE_BIT, -61.8, elements=3600) > 22
    assert flat.distance(ONE_BIT, -61.8, elements=3800) == pytest.approx(21.571, abs=5e-4)
    assert extra_elements(flat, ONE_BIT, [CONTINUOUS], "nearest") == 1400


def test_the_factory_is_its_own_mirror_image_so_half_of_its_free_cells_have_gains_of_their_own():
    for scheme, distinct in zip(SCHEMES, (495, 640, 640, 640, 640), strict=True):
        gain_db = STUDY.radio_map(scheme).gain_db
        free = np.isfinite(gain_db)
        np.testing.assert_allclose(gain_db[free], gain_db[::-1][free], rtol=0, atol=1e-12)
        assert distinct_gains(gain_db) == distinct
        gaps = np.diff(np.sort(gain_db[free]))
        assert not ((gaps > 1e-12) & (gaps < 1e-8)).any()  # so the tolerance does not matter


def test_the_committed_page_tells_open_choices_and_trade_offs_as_they_are_computed():
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    assert open_choices_section(STUDY).strip() in page
    assert trade_off_section(STUDY).strip() in page


def test_gains_between_cells_are_those_of_the_map_in_their_centres():
    radio_map = STUDY.radio_map(CONTINUOUS)
    gains = STUDY.gain_at(radio_map.grid.centres()[radio_map.free])
    np.testing.assert_allclose(gains, radio_map.gain_db[radio_map.free], rtol=0, atol=1e-9)


def test_moves_that_dip_are_found_point_by_point():
    target_db, path = -61.8, STUDY.path(CONTINUOUS, -61.8)
    centres = STUDY.radio_map(CONTINUOUS).grid.centres()
    deepest = []
    for first, second in zip(path.cells[:-1], path.cells[1:], strict=True):
        ends = centres[tuple(first)], centres[tuple(second)]
        points = np.array(
            [ends[0] + share * (ends[1] - ends[0]) for share in np.linspace(0, 1, 41)]
        )
        deepest.append(target_db - min(float(STUDY.gain_at(point[None])[0]) for point in points))
    found = dips_of_path(STUDY, CONTINUOUS, target_db)
    assert found.moves == len(deepest) == 39
    assert found.dips == sum(depth > 1e-9 for depth in deepest) == 2
    assert found.deepest_db == pytest.approx(max(deepest), abs=1e-9)
    everywhere = dips_of_map(STUDY, CONTINUOUS, target_db)
    assert everywhere.dips >= found.dips
    assert everywhere.deepest_db >= found.deepest_db


def test_nothing_dips_where_the_target_is_below_all_gains():
    lowest = float(STUDY.radio_map(WITHOUT).gain_db[STUDY.radio_map(WITHOUT).free].min())
    assert dips_of_map(STUDY, WITHOUT, lowest - 10).dips == 0


def test_the_phases_of_the_paper_attain_its_bound():
    assert model_claims(STUDY)[0].is_met


# --- drawn channels -------------------------------------------------------------------------------


@pytest.mark.parametrize("formula", [monte_carlo.lemma_1, monte_carlo.tau, monte_carlo.quantiser])
def test_drawn_channels_tell_our_formula_from_the_printed_one(formula):
    evidence = formula(STUDY, 4000, 0)
    ours, printed = evidence.deviations
    assert abs(ours) < 4
    assert abs(printed) > 20
    assert evidence.draws[-1] == 4000
    assert 0 < evidence.errors[-1] < 0.05 * evidence.means[-1]


def test_drawn_channels_of_two_panels_add_coherently():
    ours, powers = monte_carlo.several_panels(Study(load_scene("workshop")), 4000, 0).deviations
    assert abs(ours) < 4
    assert abs(powers) > 20


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_the_loss_without_the_wrap_is_drawn_and_exact(bits):
    mean, error, exact = monte_carlo.lost_amplitude_db(bits, 200_000, 0)
    assert abs(mean - exact) < 4 * error
    assert error < 0.03 * exact


def test_standard_errors_are_those_of_independent_draws():
    rng = np.random.default_rng(0)
    ends = [
        [each[-1] for each in monte_carlo.running_means(rng.normal(3, 2, (20, 50)))]
        for _ in range(400)
    ]
    means, errors, draws = np.array(ends).T
    assert set(draws) == {1000}
    assert errors.mean() == pytest.approx(2 / 1000**0.5, rel=0.02)
    assert means.std() == pytest.approx(errors.mean(), rel=0.1)


# --- cost -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", [task for task in scaling.TASKS if task.startswith("path")])
def test_every_package_is_timed_on_the_same_problem(task):
    cost = scaling.measure_task(task, 40)
    assert cost.distance == pytest.approx(STUDY.distance(CONTINUOUS, scaling.TARGET_DB), abs=1e-9)
    assert cost.cells == 1600
    assert 0 < cost.seconds < 10


def test_costs_are_measured_in_processes_of_their_own_and_read_again(tmp_path, monkeypatch):
    names = ("imports alone", "map, continuous phases")
    monkeypatch.setattr(scaling, "TASKS", {name: scaling.TASKS[name] for name in names})
    ballast = np.ones(2**26)  # 512 MiB that a child must not be charged for
    record = scaling.measure_all((40,), report=lambda line: None)
    assert ballast.nbytes == 2**29
    (tmp_path / "cost.json").write_text(json.dumps(record))
    machine, (idle, radio_map) = scaling.read_costs(tmp_path / "cost.json")
    assert machine["numpy"] == np.__version__
    assert 10 < idle.peak_mib <= radio_map.peak_mib + 5 < 400


def some_costs(**changes: float) -> list[ScalingCost]:
    costs = [ScalingCost("imports alone", 0, 0.0, 70.0, None)]
    for cells in (1600, 40_000, 1_000_000):
        seconds = changes.get("seconds", 2e-3) * (cells / 1600) ** changes.get("power", 1.0)
        costs.append(
            ScalingCost(
                "map, continuous phases", cells, seconds, changes.get("peak_mib", 100.0), None
            )
        )
        costs.append(ScalingCost("path, irs_gym", cells, seconds, 100.0, 20.0))
        costs.append(
            ScalingCost("path, networkx", cells, seconds, 100.0, 20.0 + changes.get("apart", 0.0))
        )
    return costs


@pytest.mark.parametrize(
    ("changes", "broken"),
    [
        ({}, []),
        ({"seconds": 6e-3}, [0]),
        ({"peak_mib": 1100.0}, [1]),
        ({"power": 1.5}, [2]),
        ({"apart": 1e-6}, [3]),
    ],
)
def test_promises_of_cost_are_kept_or_not(changes, broken):
    promises = cost_promises(some_costs(**changes))
    assert [n for n, promise in enumerate(promises) if not promise.is_met] == broken


def test_the_page_says_what_was_left_out_and_uses_costs_measured_before(tmp_path, written):
    machine = {"processor": "abacus", "cores": 1, "python": "3.11"}
    assert "| path, networkx |" in cost_section(machine, some_costs())
    without_largest = [cost for cost in some_costs() if cost != some_costs()[-1]]
    assert "left out: minutes" in cost_section(machine, without_largest)
    assert "## Cost" not in (written / "paper.md").read_text(encoding="utf-8")
    copy(DOCS / "cost.json", tmp_path)
    machine, costs = scaling.read_costs(tmp_path / "cost.json")
    assert cost_section(machine, costs).strip() in (DOCS / "paper.md").read_text(encoding="utf-8")
    assert {cost.cells for cost in costs} == {0, 1600, 40_000, 160_000, 1_000_000}
