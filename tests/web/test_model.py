"""The page's script against the Python engine, in a JavaScript engine."""

import json
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Evidence, Msprt, first_crossing
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from bgmodel.web.model import ALTERNATIVES, LESIONED, plain, tables
from circuits.anatomy import load_circuit
from circuits.declaration.table_files import write
from circuits.declaration.transfer import TRANSFERS
from tests.helpers import refused

quickjs = pytest.importorskip("quickjs")
SCRIPT = (files("bgmodel.web") / "model.js").read_text()
NAMES = ("macaque", "spiking_msprt")
EDITED = "edited"
"""A table from a file: a lesion in one channel, another weight, new pathways and a new nucleus."""


@pytest.fixture(scope="module")
def circuits(tmp_path_factory):
    """Return each circuit by name and number of alternatives, the edited one read from its file."""
    mine = load_circuit("macaque", 3).lesion("GPe", 0.1, channel=1).scale("STN", "SNr", 0.9)
    mine = mine.add("X like=STN", "ctx->X like=ctx->STN", "X->SNr weight=0.02")
    path = write(mine.add("GPe->GPe weight=-0.05"), tmp_path_factory.mktemp("t") / "my.toml")
    found = {(name, n): load_circuit(name, n) for name in NAMES for n in ALTERNATIVES}
    return found | {(EDITED, 3): load_circuit(path)}


@pytest.fixture(scope="module")
def js(circuits):
    """Return the script with the tables, as a function of an expression."""
    context = quickjs.Context()
    context.eval(SCRIPT)
    shown = {}
    for (name, channels), table in circuits.items():
        shown.setdefault(name, {})[str(channels)] = plain(table)
    context.eval(f"const TABLES = {json.dumps(shown)};")

    def run(expression):
        return json.loads(context.eval(f"JSON.stringify({expression})"))

    return run


def edited(table, lesions, dopamine):
    for nucleus, fraction in lesions.items():
        table = table.lesion(nucleus, fraction)
    return table.dopamine(dopamine)


def of(name, channels, lesions, dopamine):
    return f"edited(TABLES['{name}']['{channels}'], {json.dumps(lesions)}, {dopamine})"


@given(
    which=st.sampled_from([(name, n) for name in NAMES for n in ALTERNATIVES] + [(EDITED, 3)]),
    # Beyond these, circuits without a fixed point are common.
    lesions=st.fixed_dictionaries({name: st.floats(0, 0.3) for name in LESIONED}),
    dopamine=st.floats(0.7, 1.3),
    evidence=st.lists(st.floats(-8, 8), min_size=4, max_size=4),
)
@settings(max_examples=100)
def test_rates_and_out_are_those_of_the_algebra(js, circuits, which, lesions, dopamine, evidence):
    name, channels = which
    table = edited(circuits[which], lesions, dopamine)
    total = evidence[:channels]
    found = js(
        f"(() => {{ const t = {of(name, channels, lesions, dopamine)};"
        f" const x = fixedPoint(t, driveOf(t, {json.dumps(total)}));"
        " return x === null ? null : [ratesOf(t, x), outOf(t, x)]; })()"
    )
    model = BasalGanglia(table, "algebra", gain_of(circuits[which]))
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
def test_decisions_are_first_crossings_and_the_others_are_undecided(js, circuits, name):
    channels = 3
    task = {"seed": 7, "dPrime": 0.6, "conflict": 0.4, "trials": 8, "readings": 16}
    walks = np.array(js(f"walks({channels}, {json.dumps(task)})"))
    readings = np.diff(walks, axis=1, prepend=0)
    shown = Evidence(readings, np.zeros(8, dtype=int), baseline=0.0)
    intact, threshold = circuits[name, channels], 0.25
    runs = {
        "circuitOut": BasalGanglia(edited(intact, {"STN": 0.05}, 1.05), "algebra", gain_of(intact)),
        "testOut": Msprt(gain_of(intact)),
    }
    for which, test in runs.items():
        # The prior, tick 0, decides nothing here.
        found = js(
            f"decided(walks({channels}, {json.dumps(task)}), "
            f"{which}({of(name, channels, {'STN': 0.05}, 1.05)}), {threshold})"
        )
        trace = test.run(shown)
        want = first_crossing(trace, threshold, forced=False)
        done = np.flatnonzero(want.choice >= 0)
        assert 2 < len(done) < 8
        assert (found["trials"], found["decided"]) == (8, len(done))
        assert found["readings"] == pytest.approx(want.steps[done].mean())
        # Equal channels share the choice in the script, and draw it in Python.
        out = trace.out_nats[done, want.steps[done].astype(int)]
        equal = out <= out.min(axis=1, keepdims=True) + 1e-10
        assert (equal[np.arange(len(done)), want.choice[done]]).all()
        assert found["accuracy"] == pytest.approx((equal[:, 0] / equal.sum(axis=1)).mean())


def test_where_no_trial_reaches_the_threshold_there_is_no_accuracy(js):
    """A quarter of GPe lost in the default circuit: OUT never falls to the threshold."""
    task = {"seed": 7, "dPrime": 0.5, "conflict": 0, "trials": 3, "readings": 30}
    out = f"circuitOut({of('macaque', 2, {'GPe': 0.25}, 1)})"
    found = js(f"decided(walks(2, {json.dumps(task)}), {out}, -Math.log(0.82))")
    # NaN is null in JSON.
    assert found == {"trials": 3, "decided": 0, "accuracy": None, "readings": None}


def test_the_script_knows_every_transfer(js):
    assert set(js("Object.keys(TRANSFER)")) == set(TRANSFERS)


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


def refusal(table):
    """Return the sentence with which the page refuses a circuit."""
    with pytest.raises(ValueError, match=r".") as error:
        plain(table)
    return str(error.value)


def test_what_the_page_cannot_show_is_refused():
    macaque = load_circuit("macaque", 2)
    assert "not nats" in refusal(load_circuit("gpr", 3))
    assert "courses" in refusal(macaque.add("STN amount=0.1"))
    assert "D2" in refusal(load_circuit("bogacz_gurney", 2))
    assert "default_gain" in refusal(load_circuit("appendix_b", 2))
    assert "5" in refusal(load_circuit("macaque", 5))
    # Sliders can neither lesion the input nor what is replaced, nor change dopamine per channel.
    assert "GPe" in refusal(macaque.clamp("GPe", 0.1))
    assert "D1" in refusal(replace(macaque, input="D1"))
    assert "ctx->D1" in refusal(macaque.scale("ctx", "D1", 0.9, channel=0))


def test_a_file_is_shown_for_its_own_number_of_alternatives(tmp_path):
    path = write(load_circuit("macaque", 4).lesion("STN", 0.1), tmp_path / "mine.toml")
    for name in (path, str(path)):
        found = tables(name)
        assert list(found) == ["4"]
        assert found["4"] == plain(load_circuit(path))
    assert list(tables("macaque")) == ["2", "3", "4"]
    with refused(r"path missing\.toml"):
        tables(tmp_path / "missing.toml")
