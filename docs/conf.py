"""Settings of Sphinx for the site: `make docs` builds it into build/docs."""

import os
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS / "_ext"), str(DOCS.parent)]
# of the kernels of the tutorials, which start in other folders
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(DOCS.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
)
os.environ.setdefault("OMP_NUM_THREADS", "1")

import irs_gym  # noqa: E402

project = "irs_gym"
author = copyright = "the irs_gym authors"
version = release = irs_gym.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "written_pages",
    "colab_badge",
]
exclude_patterns = ["_ext", "figures"]

# Documents are Markdown; what stands between single backticks in a docstring is looked up.
default_role = "py:obj"
myst_enable_extensions = ["attrs_inline"]  # the width of a picture
myst_heading_anchors = 3
myst_links_external_new_tab = False
suppress_warnings = ["myst.header"]  # pages that commands write begin tables below a heading of 3

# Tutorials run at each build; one that fails fails it.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # seconds a cell, on a busy machine
nb_execution_in_temp = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "exclude-members": "model_config, model_post_init"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_display_short_literal_types = True
maximum_signature_line_length = 80
napoleon_google_docstring = False
napoleon_attr_annotations = False
napoleon_use_ivar = True
napoleon_custom_sections = ["Returns", "Yields"]  # ours are sentences, no lists of types
toc_object_entries_show_parents = "hide"

# Public names must be found; fields, arguments, modules and names of other packages need not.
# `tests/test_documents.py` holds every dotted name of ours to what can be imported.
PUBLIC = "|".join(irs_gym.__all__)
nitpicky = True
nitpick_ignore_regex = [(r"py:.*", rf"(?!irs_gym\.(?:{PUBLIC})$).*")]

html_theme = "furo"
html_title = "irs_gym"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
html_show_sourcelink = False
