"""`python -m eval ablations`: what each part of the task and of the setting is worth, in steps to
the optimum.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from rich.progress import track
from tyro.conf import Positional, arg

from agents.rollout.episode import evaluation_env
from eval.commands.board import build, commands_of
from eval.markdown import page, table, text
from eval.scoreboard.page import count_of, origin, seed_scores_table
from eval.scoreboard.results import find_runs, read_results
from eval.scoreboard.return_variance import DETOUR, ReturnVariance, return_variances
from irs_gym.files import write_file

FIGURES = "figures/ablations"
GAMMAS = (0.95, 0.97, 0.98, 0.99, 0.995, 0.999, 1.0)
INTRODUCTION = """# Ablations

What each part of the task and of PPO's setting is worth, at {problem}: {runs} runs. "{usual}" is the default; each
other row changes what its name says, and nothing else. Made by

{commands}

Columns are those of the [scoreboard](scoreboard.md); steps and seconds are medians over seeds, in which a seed that
never arrived is infinite. The runs shared their machine with others: compare steps, not seconds."""

WORTH = """## In steps to the optimum

How many times the default's median steps each variant took, and how many of its seeds arrived at all."""

QUESTION = """## What separates routes that differ by 2 %

An agent that has not learned yet wanders, and what it earns from a move is buried in what happens afterwards. To prefer
a route over one that is {detour:.0%} longer, it has to average returns until their standard error is below that
{metres:.2f} m. How much they scatter under uniformly random moves follows exactly from the transitions (the linear
equations of the return's mean and variance), as does the path that is best under the discounted reward (value
iteration), from the start, and from how many of all starts it is longer than the oracle's:"""

ANSWER = """A return that counts the far future counts every refused move and every aimless step of it, so its scatter
grows without bound as the discount nears 1, while the detour stays as long as it is. A discount of 0.98 looks 50 moves
ahead, about one crossing of the room, and the potential-based shaping pays for progress at once, so that nothing beyond
is needed. It has a price: under a discount the best path is not the shortest from every start, and in a maze it may be
best never to arrive ([more](shaping.md)). What remains is the scatter of the agent's own later learning: a policy that
has turned deterministic no longer sees the other route, which is what the entropy bonus is against. For DQN the same
holds with one-step returns: returns over several steps hold the random moves among them against the narrower route."""


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path = Path("docs"),
    trained_by: str | None = None,
) -> int:
    """Write ablations.md and its figures from the runs of a sweep over variants on one problem.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth.
    out
        Folder of the page.
    trained_by
        The command that trained the runs, to stand on the page.
    """
    try:
        results, left_out = read_results(track(find_runs(folder), "reading runs", transient=True))
        problems = {each.problem for each in results}
        if len(problems) != 1:
            raise ValueError(
                f"{str(folder)!r} holds runs on {len(problems)} problems: ablations are of one"
            )

        board, pictures = build(
            results, left_out, episodes=1, seed=0
        )  # of the references, which the page leaves out
        board["commands"] = commands_of("ablations", trained_by)
        world = evaluation_env(results[0].run.task).unwrapped.world  # type: ignore[attr-defined]
        found = return_variances(world, GAMMAS)
        (out / FIGURES).mkdir(parents=True, exist_ok=True)
        curves = {
            name: picture for name, picture in pictures.items() if name.endswith("-curves.png")
        }

        for name, picture in curves.items():
            write_file(out / FIGURES / name, picture)

        write_file(out / "ablations.md", markdown(board, list(curves), found).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval ablations: {error}", file=sys.stderr)
        return 2

    for each in left_out:
        print(f"left out: {each.folder}: {each.reason}", file=sys.stderr)

    print(f"{len(results)} runs, {len(left_out)} left out; written: {out / 'ablations.md'}")

    return 0


def markdown(
    board: Mapping[str, Any], figures: Sequence[str], found: Sequence[ReturnVariance]
) -> str:
    """The page of a board over variants on one problem (see `eval.commands.board.build`), and of
    the problem's outlooks.
    """
    (problem,) = board["problems"]
    standings = [each for each in problem["standings"] if each["kind"] == "learned"]
    commands = "\n".join(f"    {each}" for each in board["commands"])
    introduction = INTRODUCTION.format(
        problem=text(problem["label"]),
        runs=len(board["runs"]),
        usual=text(standings[0]["name"]),
        commands=commands,
    )

    return page(
        introduction,
        seed_scores_table(standings),
        WORTH,
        _worth(standings),
        *(f"![Learning curves of the variants]({FIGURES}/{name})" for name in figures),
        discounts_section(problem["oracle_distance"], found),
        origin(board),
    )


def discounts_section(oracle_distance: float, found: Sequence[ReturnVariance]) -> str:
    """What the discount does to the problem itself, whoever learns it."""
    question = QUESTION.format(detour=DETOUR, metres=DETOUR * oracle_distance)
    return page(question, _outlooks(found), ANSWER)


def _worth(standings: Sequence[Mapping[str, Any]]) -> str:
    """Each variant's median steps to the optimum in terms of the default's, which stands first."""
    default = standings[0]["estimates"]["steps_to_optimum"]["value"]
    rows = []

    for each in standings:
        found = each["estimates"]
        steps = found["steps_to_optimum"]["value"] if found else None
        times = (
            "never in half of the seeds"
            if steps is None or default is None
            else f"{steps / default:.2f}"
        )
        rows.append(
            (text(each["name"]), times, count_of(each, "at_optimum") if found else "0 of 0")
        )

    return table(("variant", "times the default's steps", "seeds at the optimum"), rows)


def _outlooks(found: Sequence[ReturnVariance]) -> str:
    heads = (
        "discount", "best path over the oracle's", "longer from", "scatter of the return, metres", "returns to average",
    )  # fmt: skip
    rows = [
        (
            each.gamma,
            f"{each.ratio:.3f}",
            each.longer,
            f"{each.spread:,.2f}",
            f"{each.episodes:,.0f}",
        )
        for each in found
    ]
    return table(heads, rows)
