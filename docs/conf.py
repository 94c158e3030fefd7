"""Sphinx's configuration of the site that `make docs` builds from this folder."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "bow"
author = "the authors of bow"
copyright = "the authors of bow, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "generated_reference"]
exclude_patterns = ["_build"]
# `type` in an annotation like type[Exception] is also the name of two fields here.
suppress_warnings = ["ref.python"]

# Pages are Markdown that GitHub shows as well.
myst_heading_anchors = 3

# Docstrings: numpydoc; `name` is code.
default_role = "code"
# `set` of Matplotlib's artists has a docstring for Matplotlib's own pages.
autodoc_default_options = {"members": True, "member-order": "bysource", "exclude-members": "set"}
autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
autodoc_preserve_defaults = True
add_module_names = False
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "bow"
html_static_path = ["_static"]
html_css_files = ["bow.css"]
html_show_sourcelink = False
html_show_sphinx = False
