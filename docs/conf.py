"""Sphinx configuration; pages that list a registry are written from it at build time."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from generate import write_pages
from notebook import run_pages

project = "pounding_sweep"
author = "The pounding_sweep developers"
project_copyright = "2026, the pounding_sweep developers"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "numpydoc"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
#: Pages that are run; what they printed is added in generated/.
_RUN = (
    "start.md",
    "tutorial.md",
    "pounding.ipynb",
    "reading.md",
    "own_law.md",
    "kernels.md",
    "howto_figures.md",
    "howto_gap.md",
    "howto_ida_fragility.md",
    "howto_what_matters.md",
    "howto_tables.md",
    "howto_view.md",
    "howto_frames.md",
    "howto_collapse.md",
    "howto_storey_law.md",
)
exclude_patterns = ["_build", *_RUN]
html_theme = "furo"
html_title = "pounding_sweep: parametric sweeps of seismic pounding"
html_static_path = ["_static"]
html_extra_path = ["generated/extra"]
html_css_files = ["boxes.css"]
numpydoc_show_class_members = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "none"

_generated = Path(__file__).parent / "generated"
write_pages(_generated)
run_pages([Path(__file__).parent / page for page in _RUN], _generated)
