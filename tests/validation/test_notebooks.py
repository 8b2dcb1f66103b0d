"""The tutorials run, and give the stored texts again: make validate."""

import importlib.util

import pytest

from tests.helpers import ROOT

pytest.importorskip("nbclient", reason="executing notebooks needs the docs extra")
pytest.importorskip("ipykernel", reason="executing notebooks needs the docs extra")
pytest.importorskip("cma", reason="the tutorial on fits needs the fit extra")
pytestmark = pytest.mark.validate
import nbformat  # noqa: E402


def loaded(name):
    """Return a module of the folder docs, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


tutorials = loaded("_notebooks")


@pytest.mark.parametrize("path", tutorials.notebooks(), ids=lambda path: path.stem)
def test_a_notebook_gives_the_stored_texts_again(path):
    stored = tutorials.texts(nbformat.read(path, as_version=4))
    assert tutorials.texts(tutorials.executed(path)) == stored
