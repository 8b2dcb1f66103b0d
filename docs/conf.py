"""Settings of the site; ``make docs`` builds it, offline, with warnings as errors."""

import re
import sys
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from bgmodel.version import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # the figures are part of a checkout, not of the package
from figures.gallery import write  # noqa: E402

BARS = re.compile(r"(?<!`)\|(\w+)\|(?!`)")

project = "bgmodel"
author = "The bgmodel authors"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates"]
myst_heading_anchors = 3

# One page per module, of what it defines in public; fields of a dataclass are its parameters.
autosummary_generate = True
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False

html_theme = "pydata_sphinx_theme"
html_title = "bgmodel"
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"*": []}  # no section, no sidebar
html_theme_options = {
    "header_links_before_dropdown": 6,
    "show_prev_next": False,
    "secondary_sidebar_items": ["page-toc"],
}


def keep_bars(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Escape bars in docstrings: they are absolute values, never substitutions."""
    lines[:] = [BARS.sub(r"\\|\1\\|", line) for line in lines]


def setup(app: Sphinx) -> None:
    """Write the gallery, and add what the settings above cannot say."""
    write(HERE)
    app.connect("autodoc-process-docstring", keep_bars)
    app.add_lexer("csv", TextLexer)  # Pygments has no lexer for it
