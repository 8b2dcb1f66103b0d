"""The page's script against the Python engine, in a JavaScript engine."""

import json
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, first_crossing
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from bgmodel.web.model import ALTERNATIVES, LESIONED, plain, tables
from circuits.anatomy import circuit

quickjs = pytest.importorskip("quickjs")
SCRIPT = (files("bgmodel.web") / "model.js").read_text()
NAMES = ("macaque", "spiking_msprt")


@pytest.fixture(scope="module")
def js():
    """Return the script with the tables, as a function of an expression."""
    context = quickjs.Context()
    context.eval(SCRIPT)
    context.eval(f"const TABLES = {json.dumps({name: tables(name) for name in NAMES})};")

    def run(expression):
        return json.loads(context.eval(f"JSON.stringify({expression})"))

    return run


def edited(name, channels, lesions, dopamine):
    table = circuit(name, channels)
    for nucleus, fraction in lesions.items():
        table = table.without(nucleus, fraction)
    return table.dopamine(dopamine)


def of(name, channels, lesions, dopamine):
    return f"edited(TABLES['{name}']['{channels}'], {json.dumps(lesions)}, {dopamine})"


@given(
    name=st.sampled_from(NAMES),
    channels=st.sampled_from(ALTERNATIVES),
    # Beyond these, circuits without a fixed point are common.
    lesions=st.fixed_dictionaries({name: st.floats(0, 0.3) for name in LESIONED}),
    dopamine=st.floats(0.7, 1.3),
    evidence=st.lists(st.floats(-8, 8), min_size=4, max_size=4),
)
@settings(max_examples=150)
def test_rates_and_out_are_those_of_the_algebra(js, name, channels, lesions, dopamine, evidence):
    table = edited(name, channels, lesions, dopamine)
    total = evidence[:channels]
    found = js(
        f"(() => {{ const t = {of(name, channels, lesions, dopamine)};"
        f" const x = fixedPoint(t, driveOf(t, {json.dumps(total)}));"
        " return x === null ? null : [ratesOf(t, x), outOf(t, x)]; })()"
    )
    model = BasalGanglia(table, "algebra", gain_of(circuit(name, channels)))
    values = np.array([[total]], dtype=float)
    shown = Evidence(values, np.array([0]), baseline=0.0)
    try:
        activity = model.activity(shown)
    except ValueError:
        assert found is None
        return
    rates = np.concatenate([activity.rates_hz[row.name][0, 1] for row in table.populations])
    assert np.allclose(found[0], rates, rtol=1e-9, atol=1e-9)
    assert np.allclose(found[1], activity.output_nats[0, 1], rtol=1e-9, atol=1e-9)


def test_minus_ln_p_is_the_tests(js):
    total = [1.5, -0.3, 0.2]
    want = Msprt().output(np.array(total))
    assert np.allclose(js(f"minusLogP({total})"), want, rtol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_decisions_are_first_crossings(js, name):
    channels = 3
    task = {"seed": 7, "dPrime": 0.6, "conflict": 0.4, "trials": 24, "readings": 25}
    walks = np.array(js(f"walks({channels}, {json.dumps(task)})"))
    readings = np.diff(walks, axis=1, prepend=0)
    shown = Evidence(readings, np.zeros(24, dtype=int), baseline=0.0)
    table, threshold = edited(name, channels, {"STN": 0.05}, 1.05), 0.25
    runs = {
        "circuitOut": BasalGanglia(table, "algebra", gain_of(circuit(name, channels))),
        "testOut": Msprt(gain_of(circuit(name, channels))),
    }
    for which, test in runs.items():
        # The prior, tick 0, decides nothing here.
        found = js(
            f"decided(walks({channels}, {json.dumps(task)}), "
            f"{which}({of(name, channels, {'STN': 0.05}, 1.05)}), {threshold})"
        )
        trace = test.run(shown)
        want = first_crossing(trace, threshold)
        assert found["readings"] == pytest.approx(want.steps.mean())
        # Equal channels share the choice in the script, and draw it in Python.
        out = trace.out_nats[np.arange(24), want.steps.astype(int)]
        equal = out <= out.min(axis=1, keepdims=True) + 1e-10
        assert (equal[np.arange(24), want.choice]).all()
        assert found["accuracy"] == pytest.approx((equal[:, 0] / equal.sum(axis=1)).mean())


def test_the_script_draws_normal_evidence_with_its_mean(js):
    task = {"seed": 3, "dPrime": 1.0, "conflict": 0.5, "trials": 4000, "readings": 5}
    readings = np.diff(np.array(js(f"walks(3, {json.dumps(task)})")), axis=1, prepend=0)
    separation = 1 / np.sqrt(2)
    se = separation / np.sqrt(20_000)
    for channel, factor in enumerate((1.0, 0.5, 0.0)):
        assert abs(readings[..., channel].mean() - factor * separation**2) < 4 * se
        assert readings[..., channel].std() == pytest.approx(separation, rel=0.03)
    assert abs(np.corrcoef(readings[..., 0].ravel(), readings[..., 1].ravel())[0, 1]) < 0.03


def test_a_script_with_a_wrong_sign_is_seen(js):
    """The control: what is compared moves when the script is broken."""
    broken = quickjs.Context()
    broken.eval(SCRIPT.replace("const change = path.sign", "const change = -path.sign"))
    broken.eval(f"const TABLES = {json.dumps({'macaque': tables('macaque')})};")
    call = "JSON.stringify((() => { const t = edited(TABLES.macaque['2'], {}, 1.2);"
    call += " return outOf(t, fixedPoint(t, driveOf(t, [1, 0]))); })())"
    right = js(call.removeprefix("JSON.stringify(").removesuffix(")"))
    assert not np.allclose(json.loads(broken.eval(call)), right, rtol=1e-3)


def test_a_table_without_nats_or_a_slid_nucleus_is_refused():
    with pytest.raises(ValueError, match="not nats"):
        plain(circuit("gpr", 3))
    with pytest.raises(ValueError, match="macaque has courses, and the page knows no time"):
        plain(circuit("macaque", 2).with_rows("STN amount=0.1"))
