"""A badge on each tutorial that opens it in Colab, which reads notebooks from GitHub alone.

The repository is that of the build, `GITHUB_REPOSITORY`, which GitHub's runners set; elsewhere
there is none, and no badge.
"""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

BADGE = (
    "[![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)]"
    "(https://colab.research.google.com/github/{repository}/blob/{branch}/docs/{name}.ipynb)"
)


def add_badge(app: Sphinx, name: str, source: list[str]) -> None:
    """Put the badge below the title, the first line of the first cell."""
    repository = os.environ.get("GITHUB_REPOSITORY")
    if not repository or not str(app.env.doc2path(name)).endswith(".ipynb"):
        return

    notebook = json.loads(source[0])
    branch = os.environ.get("GITHUB_REF_NAME", "main")
    badge = BADGE.format(repository=repository, branch=branch, name=name)
    title, *rest = "".join(notebook["cells"][0]["source"]).split("\n")
    notebook["cells"][0]["source"] = "\n".join([title, "", badge, *rest])
    source[0] = json.dumps(notebook)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the badge as a page is read."""
    app.connect("source-read", add_badge)
    return {"parallel_read_safe": True}
