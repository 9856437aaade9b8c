"""Facts of the model cards: each model has one, it is that of the manifest, and its block loads it."""

import re

import pytest
import yaml

from agents.runs.pretrained import MODELS, Models
from eval.commands.cards import main
from eval.model_cards import INDEX, model_cards
from irs_gym import lab

MANIFEST = Models.read(MODELS)
ENTRIES = [*MANIFEST.models, *MANIFEST.generalists]


def test_cards_are_those_of_the_manifest():
    kept = {each.name: each.read_text() for each in MODELS.glob("*.md")}
    assert kept == model_cards(MANIFEST)


def test_each_model_has_a_card_and_a_row():
    cards = model_cards(MANIFEST)
    names = {each.file.replace(".npz", ".md") for each in ENTRIES}
    assert set(cards) == {*names, INDEX}
    assert {name for name in names if f"]({name})" not in cards[INDEX]} == set()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda each: each.file)
def test_the_block_of_a_card_loads_that_model(entry):
    card = model_cards(MANIFEST)[entry.file.replace(".npz", ".md")]
    (call,) = re.findall(r"^model = load_pretrained\((.*)\)$", card, re.MULTILINE)
    found = eval(f"load_pretrained({call})", {"load_pretrained": lab.load_pretrained})
    assert found.entry == entry


def test_facts_on_top_are_those_that_hubs_read():
    card = model_cards(MANIFEST)["ppo-61.8dB-continuous.md"]
    facts = yaml.safe_load(card.split("---\n")[1])
    (result,) = facts["model-index"][0]["results"]
    assert facts["license"] == "mit"
    assert {each["type"]: each["value"] for each in result["metrics"]}["SPL"] == pytest.approx(1.0)


def test_cards_are_written_beside_their_models(tmp_path):
    (tmp_path / "manifest.json").write_bytes((MODELS / "manifest.json").read_bytes())
    assert main(tmp_path) == 0
    assert {each.name for each in tmp_path.glob("*.md")} == set(model_cards(MANIFEST))


def test_a_damaged_manifest_is_told(tmp_path, capsys):
    (tmp_path / "manifest.json").write_text("{}]")
    assert main(tmp_path) == 2
    assert "is damaged" in capsys.readouterr().err
