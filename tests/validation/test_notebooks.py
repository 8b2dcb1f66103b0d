"""The tutorials run, and give the stored texts again: make validate."""

import importlib.util
import json
import re

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


DECIMALS = re.compile(r" *-?\d+\.\d+(?:e-?\d+)?")
FITS = ("known_evidence", "own_trials")
"""Where the search for a maximum ends depends on how a processor rounds: by less than 2 % here."""


@pytest.mark.parametrize("path", tutorials.notebooks(), ids=lambda path: path.stem)
def test_a_notebook_gives_the_stored_texts_again(path):
    stored = tutorials.texts(nbformat.read(path, as_version=4))
    told = tutorials.texts(tutorials.executed(path))
    if path.stem not in FITS:
        assert told == stored
        return
    texts = [json.dumps(each, sort_keys=True) for each in (told, stored)]
    assert DECIMALS.sub("#", texts[0]) == DECIMALS.sub("#", texts[1])
    numbers = ([float(number) for number in DECIMALS.findall(text)] for text in texts)
    assert next(numbers) == pytest.approx(next(numbers), rel=0.02)
