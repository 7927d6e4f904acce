"""Settings of the documentation, for Sphinx: ``make docs`` builds it into docs/_build/html."""

from __future__ import annotations

import sys
import tomllib
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "extensions"))

project = "flexinv"
author = "flexinv developers"
copyright = "flexinv developers"
release = metadata.version("flexinv")
version = ".".join(release.split(".")[:2])

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "plain_docstrings",
    "generated_pages",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = [
    "sg_execution_times.rst",
    "examples/models",
    "reference/generated/engines.md",
    "reference/generated/causes.md",
    "_build",
    "workflows",
    "gallery",
    "extensions",
    "figures",
    "studies",
]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
html_math_renderer = "mathml"  # the browser draws formulas itself: no script, nothing asked of other machines
html_theme = "furo"
html_title = "flexinv and crosscheck"
html_static_path = ["_static"]
html_favicon = "_static/icon.svg"  # without one a browser asks the server for a file that is not there
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#15497f", "color-brand-content": "#15497f"},
    "dark_css_variables": {"color-brand-primary": "#8fc1f5", "color-brand-content": "#8fc1f5"},
}
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": True}
copybutton_prompt_text = r"\$ "
copybutton_prompt_is_regexp = True
smartquotes = False  # an option is typed --out, not –out
suppress_warnings = ["config.cache"]
linkcheck_ignore = [r"https?://localhost", r"tcp://.*"]

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 3600,
    "write_computation_times": False,
    "capture_repr": ("_repr_html_",),
    "ignore_repr_types": r"plotly",  # else the page itself holds the figure, and loads a script from another machine
    "abort_on_example_error": True,
    "matplotlib_animations": False,
    "image_scrapers": ("gallery_views.scrape_figures", "gallery_views.scrape"),
    "reset_modules_order": "both",
    "reset_modules": ("matplotlib", "gallery_views.in_the_project"),
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
