"""Settings of the site; ``make docs`` builds it, offline, with warnings as errors."""

import gc
import re
import sys
from pathlib import Path
from typing import Any

from jinja2.sandbox import SandboxedEnvironment
from numpydoc import docscrape_sphinx
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

from bgmodel.support import __version__
from bgmodel.support.references import references

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]  # the figures are part of a checkout
from _notebooks import TUTORIALS, with_download  # noqa: E402

from figures.gallery import write  # noqa: E402

BARS = re.compile(r"(?<!`)\|(\w+)\|(?!`)")

gc.set_threshold(50_000, 20, 50)  # a build keeps what it creates: collecting took a sixth of it

# numpydoc would compile its template for each docstring, a quarter of the time of the build.
TEMPLATES: dict[type, SandboxedEnvironment] = {}


def environment(loader: Any) -> SandboxedEnvironment:
    """Return the environment of a kind of loader, created once."""
    return TEMPLATES.setdefault(type(loader), SandboxedEnvironment(loader=loader))


docscrape_sphinx.SandboxedEnvironment = environment

REFERENCES = """# References

Sources that pages, tables and code cite by author and year, from `bgmodel/data/references.bib`.
Volumes, pages and DOIs that could not be looked up are left out.

"""

project = "bgmodel"
author = "The bgmodel authors"
version = release = __version__

# myst_nb includes myst_parser.
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # outputs are stored: make notebooks
nb_code_prompt_show = "Show the code"
nb_code_prompt_hide = "Hide the code"

# One page per module, of what it defines in public; fields of a dataclass are its parameters.
autosummary_generate = True
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False

html_theme = "pydata_sphinx_theme"
html_title = "bgmodel"
html_static_path = ["_static"]
html_css_files = ["tables.css"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"*": []}  # no section, no sidebar
html_theme_options = {
    "header_links_before_dropdown": 7,
    "show_prev_next": False,
    "secondary_sidebar_items": ["page-toc"],
}


def keep_bars(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Escape bars in docstrings: they are absolute values, never substitutions."""
    lines[:] = [BARS.sub(r"\\|\1\\|", line) for line in lines]


def add_download(app: Sphinx, docname: str, source: list[str]) -> None:
    """Add the version and a link to the file to the page of a notebook."""
    name = f"{Path(docname).name}.ipynb"
    if docname.startswith("tutorials/") and (TUTORIALS / name).is_file():
        source[0] = with_download(source[0], name)


def setup(app: Sphinx) -> None:
    """Write the gallery and the references, and add what the settings above cannot say."""
    write(HERE)
    listed = [
        f"- {str(one).replace('https:', '<https:')}{'>' * bool(one.link)}" for one in references()
    ]
    (HERE / "references.md").write_text(REFERENCES + "\n".join(listed) + "\n", encoding="utf-8")
    app.connect("source-read", add_download)
    app.connect("autodoc-process-docstring", keep_bars)
    app.add_lexer("csv", TextLexer)  # Pygments has no lexer for it
