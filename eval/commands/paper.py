"""`python -m eval paper`: every claim and figure of the paper's Section IV, and what lies beyond,
as one page.
"""

import json
import sys
from importlib.util import find_spec
from pathlib import Path

from eval.markdown import Promise, page, template
from eval.paper import beyond_sections as beyond
from eval.paper import monte_carlo, scaling, sections
from eval.paper.claim import Claim
from eval.paper.curve_figures import (
    draw_cost_of_grid,
    draw_distance_over_elements,
    draw_distance_over_target,
    draw_evidence,
)
from eval.paper.distance_claims import distance_claims, element_claims, threshold_claims
from eval.paper.map_claims import map_claims, model_claims, path_claims
from eval.paper.map_figures import (
    draw_gain_maps,
    draw_optimal_gain,
    draw_own_scene,
    draw_paths,
    draw_scene,
)
from eval.paper.study import Study
from irs_gym import load_scene
from irs_gym.files import write_file

PARTS = (map_claims, path_claims, threshold_claims, distance_claims, element_claims, model_claims)
DRAWINGS = (
    draw_scene,
    draw_gain_maps,
    draw_paths,
    draw_distance_over_target,
    draw_distance_over_elements,
    draw_optimal_gain,
)
OWN_SCENE = "workshop"
OWN_TARGET_DB = -63.0


def main(
    scene: str = "paper",
    out: Path = Path("docs"),
    cost: bool = True,
    draws: int = 40_000,
    seed: int = 0,
) -> int:
    """Compute every claim and figure of the paper, write the page, and fail where a promised claim
    is not met.

    Writes OUT/paper.md, OUT/cost.json, and OUT/figures with each figure as PNG, SVG and CSV.

    Parameters
    ----------
    scene
        The paper's scene, or the path of a variant of it.
    out
        Folder of the page.
    cost
        Measure time and memory too (some minutes); otherwise the measurements in OUT are used, if
        there are any.
    draws
        Draws of the channels for each correction.
    seed
        Seed of these draws.
    """
    try:
        study = Study(load_scene(scene))
        check_study(study, cost, draws)
        return write(study, out, cost, draws, seed)
    except (OSError, ValueError) as error:
        print(f"python -m eval paper: {error}", file=sys.stderr)
        return 2


def check_study(study: Study, cost: bool, draws: int) -> None:
    """Refuse what the paper's claims cannot be told of, before any work."""
    scene = study.scene
    access_points = len(scene.access_points)
    panels = len(scene.irs_panels)
    if (access_points, panels) != (1, 1):
        raise ValueError(
            f"scene {scene.name!r} has {access_points} access points and {panels} panels, "
            "not 1 and 1"
        )
    if scene.format_version != 1:
        raise ValueError(
            f"scene {scene.name!r} has format_version {scene.format_version}: the paper's claims "
            "are about boxes in a rectangle, which is format 1"
        )
    if draws < 2 * monte_carlo.BATCH:
        raise ValueError(f"draws={draws} must be {2 * monte_carlo.BATCH} or more")

    packages = ("shapely", "networkx", "skimage") if cost else ("shapely",)
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise ValueError(f'{", ".join(missing)} not installed: pip install -e ".[train,test]"')

    _ = study.start, study.goal  # raises where they lie outside of the grid


def write(study: Study, out: Path, cost: bool, draws: int, seed: int) -> int:
    """Write page and figures; the exit status."""
    figures = out / "figures"
    figures.mkdir(parents=True, exist_ok=True)

    # what is computed
    claims = [claim for part in PARTS for claim in part(study)]
    formulas = (monte_carlo.lemma_1, monte_carlo.tau, monte_carlo.quantiser)
    evidence = [formula(study, draws, seed) for formula in formulas]
    own = Study(load_scene(OWN_SCENE))
    panels = monte_carlo.several_panels(own, draws, seed)
    lost = {bits: monte_carlo.lost_amplitude_db(bits, 25 * draws, seed) for bits in (1, 2, 3)}

    for draw in DRAWINGS:
        draw(study, figures)

    draw_evidence(evidence, figures)
    draw_own_scene(own, OWN_TARGET_DB, figures)
    grid = draw_cost_of_grid(study, figures)

    if cost:
        write_file(out / "cost.json", (json.dumps(scaling.measure_all(), indent=2) + "\n").encode())

    measured = scaling.read_costs(out / "cost.json") if (out / "cost.json").is_file() else None

    text = page(
        template("paper.md"),
        sections.claims_section(claims),
        *sections.FIGURES,
        sections.corrections_section([*evidence, panels], lost),
        sections.open_choices_section(study),
        beyond.trade_off_section(study),
        beyond.optimal_section(study),
        beyond.grid_section(grid),
        beyond.own_scene_section(own, OWN_TARGET_DB),
        beyond.ELSEWHERE,
        beyond.cost_section(*measured) if measured else "",
    )
    write_file(out / "paper.md", text.encode())
    print(f"written: {out / 'paper.md'} and {figures}")

    return report(claims, beyond.cost_promises(measured[1]) if measured else [])


def report(claims: list[Claim], promises: list[Promise]) -> int:
    """Print the verdicts; 1 where something promised is not met, else 0."""
    for claim in claims:
        print(f"{claim.verdict:>18}  {claim.text}: {' / '.join(claim.ours)}")

    for promise in promises:
        print(f"{'met' if promise.is_met else 'NOT MET':>18}  {promise.text}: {promise.value}")

    broken = [each for each in claims if each.is_promised and not each.is_met]
    failed = len(broken) + sum(not promise.is_met for promise in promises)
    if failed:
        print(f"{failed} of the claims that are said to be met are not", file=sys.stderr)

    return int(failed > 0)
