"""One call: the same table as that of its parts, for a circuit as it is or edited."""

import subprocess
import sys

import pandas as pd
import pytest

import bgmodel
from bgmodel import compare, stream
from bgmodel.comparison.circuits import compare_with_msprt
from bgmodel.comparison.with_msprt import model_of
from bgmodel.evidence import separated_evidence
from circuits.anatomy import load_circuit

EVIDENCE = separated_evidence(120, 40, 1.0, rng=stream(4, "one call"), step_ms=50.0)
GIVEN = {"seed": 3, "engine": "population", "accuracies": (0.9,), "resamples": 50}


def test_one_call_gives_what_its_parts_give_for_an_edited_circuit():
    edited = load_circuit("spiking_msprt").scale("D1", "SNr", 0.95)
    found = compare(edited, EVIDENCE, **GIVEN)
    model = model_of(edited, EVIDENCE, engine="population", gain=None, seed=3, workers=1)
    parts = compare_with_msprt(model, EVIDENCE, seed=3, rivals=(), accuracies=(0.9,), resamples=50)
    pd.testing.assert_frame_equal(found, parts)
    assert set(found["model"]) == {"circuit", "cortical decoder"}
    whole = compare("spiking_msprt", EVIDENCE, **GIVEN)
    assert not whole.equals(found)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"engine": "spikes"}, "engine must be one of algebra"),
        ({"rivals": ["ddm"]}, "rivals must be among race, LCA"),
        ({"gain": 0.0}, "gain must be > 0"),
    ],
)
def test_what_is_unknown_is_refused_in_one_sentence(given, says):
    with pytest.raises(ValueError, match=says):
        compare("spiking_msprt", EVIDENCE, **{**GIVEN, **given})


def test_a_circuit_of_other_channels_is_refused():
    with pytest.raises(ValueError, match="2 hypotheses, spiking_msprt has 3 channels"):
        compare(load_circuit("spiking_msprt", 3), EVIDENCE, **GIVEN)


def test_the_package_offers_its_lazy_names_and_loads_them_where_they_are_used():
    assert {"compare", "BasalGanglia"} <= set(bgmodel.__all__) <= set(dir(bgmodel))
    code = (
        "import sys, bgmodel\n"
        "assert 'pandas' not in sys.modules and 'circuits.circuit' not in sys.modules\n"
        "dir(bgmodel)\n"
        "assert 'pandas' not in sys.modules\n"
        "from bgmodel import BasalGanglia\n"
        "assert 'circuits.circuit' in sys.modules\n"
        "assert not hasattr(bgmodel, 'nothing')\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
