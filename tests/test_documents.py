"""Facts of the documents: what they name is there, under that name, and the drawing is that of the
contracts.
"""

import re
import subprocess
import tomllib
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from agents import registry

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("irs_gym", "agents", "train", "eval")
ARCHITECTURE = ROOT / "docs" / "architecture.md"
BY_HAND = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
        *ROOT.glob(".github/**/*.md"),
        ARCHITECTURE,
        *(ROOT / "docs" / name for name in ("index.md", "glossary.md", "results.md")),
        *ROOT.glob("docs/concepts/*.md"),
        *ROOT.glob("docs/guides/*.md"),
    ]
)
SOURCES = sorted(each for name in PACKAGES for each in ROOT.glob(f"{name}/**/*.py"))
MADE_BY_USE = {"runs", ".venv", "build"}  # folders that a checkout has once it has been worked in
WRITTEN = {"environments", "api", "models"}  # folders of docs/ that each build of the site writes

each_document = pytest.mark.parametrize(
    "document", BY_HAND, ids=lambda each: str(each.relative_to(ROOT))
)


def contracts() -> dict[str, list[str]]:
    """Rows of each package's contract, from the top down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    return {
        each["containers"][0]: each["layers"]
        for each in settings["contracts"]
        if "containers" in each
    }


@cache
def resolve(name: str) -> Any:
    """What a dotted name stands for: a module, or something in one; None for a field of a class."""
    words = name.split(".")
    found = import_module(words[0])

    for count, word in enumerate(words[1:], start=2):
        if isinstance(found, type) and word in found.__annotations__:
            return None

        try:
            found = getattr(found, word)
        except AttributeError:
            found = import_module(".".join(words[:count]))

    return found


def is_written(link: Path) -> bool:
    """Whether a link leads to a page that each build of the site writes, and checks."""
    docs = ROOT / "docs"
    path = link.resolve()
    return path.is_relative_to(docs) and path.relative_to(docs).parts[0] in WRITTEN


@each_document
def test_links_lead_to_files(document):
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", document.read_text())
    own = [document.parent / link for link in links if not link.startswith(("http:", "https:"))]
    kept = [link for link in own if not is_written(link)]
    assert [str(link) for link in kept if not link.exists()] == []


@each_document
def test_paths_in_code_type_are_there(document):
    text = re.sub(r"^```.*?^```$", "", document.read_text(), flags=re.DOTALL | re.MULTILINE)
    paths = re.findall(r"`((?:\.?\w[\w.-]*/)+[\w.*-]*)`", text)
    own = {path for path in paths if path.split("/")[0] not in MADE_BY_USE}
    assert {path for path in own if not any(ROOT.glob(path.rstrip("/")))} == set()


def test_dotted_names_can_be_imported():
    name_in_code = re.compile(rf"`+((?:{'|'.join(PACKAGES)})(?:\.\w+)+)(?:\(.*?\))?`+")
    wrong = []

    for text in [*BY_HAND, *SOURCES]:
        for name in name_in_code.findall(text.read_text()):
            try:
                resolve(name)
            except ImportError:
                wrong.append(f"{text.relative_to(ROOT)}: {name}")

    assert wrong == []


def test_names_beside_a_file_stand_in_it():
    rows = re.findall(
        r"^\| `([\w/]+\.py)` \| (.*?) \|", ARCHITECTURE.read_text(), flags=re.MULTILINE
    )
    assert len(rows) > 10
    wrong = [
        f"{name}: not in {file}"
        for file, cell in rows
        for name in re.findall(r"`(\w+)", cell)
        if not re.search(rf"\b{name}\b", (ROOT / file).read_text())
    ]
    assert wrong == []


@pytest.mark.parametrize("package", PACKAGES)
def test_the_drawing_is_that_of_the_contracts(package):
    drawing = re.search(
        rf"^```text\n{package}\n(.*?)^```$", ARCHITECTURE.read_text(), re.DOTALL | re.MULTILINE
    )
    assert drawing, f"no drawing of {package}"
    drawn = [re.split(r" {2,}", line.strip())[0] for line in drawing[1].splitlines()]
    assert drawn == [row.replace("(", "").replace(")", "") for row in contracts()[package]]


def test_the_row_of_an_algorithm_is_one():
    (block,) = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / "CONTRIBUTING.md").read_text(), re.DOTALL | re.MULTILINE
    )
    rows = eval(f"{{{block}}}", {"Row": registry.Row})
    assert rows["sarsa"].track == "scene"


def test_make_alone_tells_every_target():
    told = subprocess.check_output(["make", "--no-print-directory"], cwd=ROOT, text=True)
    phony = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony
    assert re.findall(r"^make (\w+)", told, re.MULTILINE) != []
    assert sorted(re.findall(r"^make (\w+)", told, re.MULTILINE)) == sorted(phony[1].split())


@each_document
def test_targets_of_make_are_there(document):
    known = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"(?:^|`)make (\w+)", document.read_text(), re.MULTILINE)) <= known
