"""`python -m eval COMMAND`: each command is the function `main` of `eval/commands/COMMAND.py`."""

import sys
from functools import partial
from importlib import import_module

from agents.runs.interruption import exit_at_once, interruptible, leave

# Modules are imported when their command is run, so that none pays for the packages of another.
COMMANDS = {
    "paper": "compute every claim and figure of the paper and write docs/paper.md",
    "sionna": "trace the paper's room with Sionna RT and write docs/sionna.md",
    "outage": "prove the outage in closed form by drawn channels and write docs/fading.md",
    "measured": "show a measured room, its optima and PPO in it, and write docs/measured.md",
    "score": "score a trained run against the oracle and draw both paths over the map",
    "board": "put all runs below a folder on one scoreboard, with intervals over seeds",
    "budget": (
        "tell what is learned under budgets, beside the exact optimum, and write docs/budget.md"
    ),
    "continuous": (
        "tell what is learned where the robot goes anywhere, beside the exact optimum, "
        "and write docs/continuous.md"
    ),
    "ablations": (
        "tell what each part of the task and of the setting is worth in steps to the optimum"
    ),
    "shaping": (
        "tell where a discount makes another path than the shortest the best, "
        "and write docs/shaping.md"
    ),
    "scenes": "draw the scenes of the package and write docs/scenes.md",
    "families": "draw the families of generated factories and write docs/families.md",
    "codebook": (
        "compute how few configurations of the panel make the best path, tell what was learned, "
        "and write docs/codebook.md"
    ),
    "generalisation": (
        "put all runs over many scenes on one page: scenes never seen, of any kind, and the paper's"
    ),
    "headroom": (
        "compute what a policy that sees only a patch could reach at most in small rooms, "
        "and write docs/headroom.md"
    ),
    "intervals": (
        "make every interval in docs/ anew from the results beside it, and write docs/intervals.md"
    ),
    "bounds": (
        "prove how short a continuous path can be in the paper's scene, and write docs/bounds.md"
    ),
    "grids": "compare the oracle with the lengths that the MovingAI benchmarks publish",
    "submit": "write an agent's episodes on a track of the leaderboard, to hand in",
    "verify": "play submissions anew, and accept or refuse each",
    "leaderboard": "verify all submissions of a folder and write docs/leaderboard.md",
    "speed": "time the environments beside others",
    "pretrain": "keep the best policy of each algorithm on each problem in models/",
    "cards": "write the model cards of models/, from its manifest",
    "watch": "show a pretrained model, a run or a reference policy on its way",
    "play": "steer the robot from the keyboard",
    "workbench": "time the workbench in a browser and draw docs/figures/workbench.png",
    "animate": "write an episode of a run or of a reference policy as a GIF",
}


def main() -> int:
    """Run the command named first; its arguments make the rest of the command line. Returns the
    exit status.
    """
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in COMMANDS:
        width = max(map(len, COMMANDS))
        print("usage: python -m eval COMMAND [--help]\n")
        for command, summary in COMMANDS.items():
            print(f"  {command:<{width}}  {summary}")

        return 0 if name in ("-h", "--help") else 2

    import tyro  # here, so that a Ctrl-C meanwhile ends in one line

    program = f"python -m eval {name}"
    main_of_command = import_module(f"eval.commands.{name}").main
    run = partial(tyro.cli, main_of_command, args=arguments, prog=program)

    return interruptible(program, lambda: run() or 0)


if __name__ == "__main__":
    exit_at_once("python -m eval")
    leave(main())
