"""`python -m eval cards`: writes the model cards of models/, from its manifest."""

import sys
from pathlib import Path

from agents.runs.pretrained import MODELS, Models
from eval.model_cards import model_cards
from irs_gym.files import write_file


def main(folder: Path = MODELS) -> int:
    """Write a card for each model of a folder beside it, and README.md, which lists them.

    Parameters
    ----------
    folder
        Folder of the models and their manifest.
    """
    try:
        cards = model_cards(Models.read(folder))
        for name, card in cards.items():
            write_file(folder / name, card.encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval cards: {error}", file=sys.stderr)
        return 2

    print(f"written: {len(cards)} pages in {folder}")
    return 0
