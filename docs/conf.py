# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Configure Sphinx for the documentation site (`make docs`). It needs no network."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_site"))

import warpvis

from reference import WORDS

project = "warpvis"
author = "The warpvis authors"
project_copyright = "2026, The warpvis authors"
release = warpvis.__version__

# `reference` and `live` are in `_site`.
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "reference",
    "live",
]
exclude_patterns = ["_site", "_build", "internals/README.md"]
suppress_warnings = [
    "myst.header",  # included parts of the README begin below its title
    "ref.python",  # two modules have a class `Lens`; the nearer one is used
]

# A word in single backticks in a docstring is a link if it is a public name, else code.
default_role = "py:obj"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": True, "exclude-members": "__init__, __new__"}
autodoc_preserve_defaults = True
autodoc_type_aliases = {word: word for word in WORDS}
napoleon_use_rtype = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 100
add_module_names = False

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# Notebooks are committed without outputs and run here; a failure ends the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True  # their files are not written to docs/
nb_ipywidgets_js = {}  # these scripts would be loaded from a network
nb_merge_streams = True

html_theme = "furo"
html_title = "warpvis"
html_static_path = ["_site/static"]
html_css_files = ["warpvis.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b6e99", "color-brand-content": "#0b6e99"},
    "dark_css_variables": {"color-brand-primary": "#5cc3ee", "color-brand-content": "#5cc3ee"},
}
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
