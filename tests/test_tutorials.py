"""Facts of the tutorials: notebooks kept without outputs, which Colab can open; the build of the
site runs them.
"""

import json
from importlib import util
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = sorted(ROOT.glob("docs/tutorials/*"))

each_tutorial = pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda each: each.stem)


def badged(name: str, suffix: str, text: str) -> str:
    """A page's source as the site's extension hands it on."""
    spec = util.spec_from_file_location("colab_badge", ROOT / "docs" / "_ext" / "colab_badge.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    app = SimpleNamespace(env=SimpleNamespace(doc2path=lambda each: f"{each}{suffix}"))
    source = [text]
    module.add_badge(app, name, source)
    return source[0]


@each_tutorial
def test_a_tutorial_is_a_notebook_without_outputs(tutorial):
    assert tutorial.suffix == ".ipynb"
    code = [each for each in json.loads(tutorial.read_text())["cells"] if "outputs" in each]
    assert code
    assert [each for each in code if each["outputs"] or each["execution_count"] is not None] == []


@each_tutorial
def test_a_tutorial_installs_what_it_needs_where_that_is_missing(tutorial):
    first = next(
        each for each in json.loads(tutorial.read_text())["cells"] if each["cell_type"] == "code"
    )
    assert '%pip install --quiet "irs_gym[train]"' in "".join(first["source"])


@each_tutorial
def test_a_tutorial_is_listed(tutorial):
    assert f"tutorials/{tutorial.stem}\n" in (ROOT / "docs" / "index.md").read_text()
    assert f"(docs/tutorials/{tutorial.name})" in (ROOT / "README.md").read_text()


@each_tutorial
def test_its_badge_stands_below_the_title_and_leads_to_the_repository(tutorial, monkeypatch):
    monkeypatch.setenv("GITHUB_REPOSITORY", "someone/irs_gym")
    monkeypatch.setenv("GITHUB_REF_NAME", "main")
    name = f"tutorials/{tutorial.stem}"
    found = json.loads(badged(name, ".ipynb", tutorial.read_text()))["cells"][0]["source"]
    title, _, badge = found.split("\n")[:3]
    assert title.startswith("# ")
    assert badge.endswith(
        f"(https://colab.research.google.com/github/someone/irs_gym/blob/main/docs/{name}.ipynb)"
    )


def test_no_badge_where_the_repository_is_unknown_or_the_page_no_notebook(monkeypatch):
    notebook = TUTORIALS[0].read_text()
    monkeypatch.delenv("GITHUB_REPOSITORY", raising=False)
    assert badged("tutorials/any", ".ipynb", notebook) == notebook
    monkeypatch.setenv("GITHUB_REPOSITORY", "someone/irs_gym")
    assert badged("index", ".md", "# A page") == "# A page"
