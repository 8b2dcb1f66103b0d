"""The page: one file, whole, and what it says in a browser is what the script computes."""

import html
import json
import re
import shutil
import subprocess

import pytest

from bgmodel.web.page import page
from circuits.anatomy import load_circuit
from circuits.declaration.table_files import write
from tests.helpers import run

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


def test_it_is_one_file_that_asks_nothing_of_the_net():
    text = page("macaque")
    assert not re.search(r"""(?:src|href)\s*=|@import|fetch\(|https?://""", text)
    assert "/*MODEL*/" not in text
    assert "/*TABLES*/" not in text
    assert "it needs JavaScript" in text


def test_every_control_has_a_name_and_its_value_is_shown():
    text = page("macaque")
    ids = re.findall(r'<input type="range" id="(\w+)"', text)
    assert {"STN", "GPe", "D1", "D2", "dopamine", "posterior", "conflict"} <= set(ids)
    for name in ids:
        assert re.search(
            rf'<label>[^<]+<output for="{name}"></output><input type="range" id="{name}"', text
        )


STUB = """
const elements = {};
const document = {
  getElementById: (id) => elements[id] || (elements[id] = { value: VALUES[id], attributes: {},
    addEventListener() {}, setAttribute(name, value) { this.attributes[name] = value; } }),
  querySelectorAll: () => [],
};
const clearTimeout = () => {}, setTimeout = (f) => f();
"""
"""What the page's script needs of a browser."""
START = {"D1": 0, "D2": 0, "STN": 0, "GPe": 0, "dopamine": 1, "posterior": 0.82, "dPrime": 0.5}
START |= {"conflict": 0, "lead": 2}


def opened(circuit, channels=2, trials=1, readings=2, **sliders):
    """Run the page's scripts; return what its elements hold then."""
    quickjs = pytest.importorskip("quickjs")
    values = START | {"channels": str(channels)} | sliders
    context = quickjs.Context()
    context.eval(f"const VALUES = {json.dumps(values)};" + STUB)
    # The engine of these tests is slow: a second per trial of 40 readings.
    text = page(circuit).replace(
        "trials: 300, readings: 40", f"trials: {trials}, readings: {readings}"
    )
    for script in re.findall(r"<script>(.*?)</script>", text, re.DOTALL):
        context.eval(script)
    return json.loads(context.eval("JSON.stringify(elements)"))


def drawn(elements):
    """Return the pathways and the number of boxes in the drawing."""
    svg = elements["nuclei"]["innerHTML"]
    assert "NaN" not in svg
    named = re.findall(r'data-pathway="([^"]+)"[^>]*marker-end="url\(#(\w+)\)"', svg)
    return {html.unescape(name): end for name, end in named}, svg.count('stroke="#444"')


def test_every_pathway_and_nucleus_of_the_circuit_is_drawn(tmp_path):
    mine = load_circuit("macaque", 3).add(
        "X<1 like=STN", "X<1->SNr weight=0.1", "GPe->GPe weight=-0.1", "D1->GPe weight=-0.1"
    )
    write(mine, tmp_path / "mine.toml")
    for name, n in (("macaque", 2), ("spiking_msprt", 2), (tmp_path / "mine.toml", 3)):
        table = load_circuit(name, n)
        elements = opened(name, n)
        ends = {p.name: "dot" if p.weight < 0 else "arrow" for p in table.projections}
        assert drawn(elements) == (ends, len(table.populations))
        assert table.name in elements["circuit"]["textContent"]
    assert elements["channels"]["innerHTML"] == "<option>3</option>"


def test_undecided_trials_are_said_and_give_no_accuracy():
    """With a quarter of GPe lost no trial is decided: only the other two points are drawn."""
    elements = opened("macaque", trials=4, readings=30, GPe=0.25)
    changed, intact, _ = elements["said"]["textContent"].split("\n")
    assert "none of 4 trials" in changed
    assert "accuracy" not in changed
    assert re.search(r"\b[2-4] of 4 trials decided .* accuracy [01]\.\d\d", intact)
    assert elements["tradeoff"]["innerHTML"].count("<circle") == 2
    assert "NaN" not in elements["tradeoff"]["innerHTML"]
    assert opened("macaque", readings=30)["tradeoff"]["innerHTML"].count("<circle") == 3


def test_the_command_writes_it_and_refuses_what_it_cannot_show(tmp_path, capsys):
    assert run("page", tmp_path / "circuit.html") == 0
    assert (tmp_path / "circuit.html").read_text() == page("macaque")
    assert "open it in a browser" in capsys.readouterr().out
    assert run("page", tmp_path / "circuit.txt") == 2
    assert run("page", tmp_path / "gpr.html", "--circuit", "gpr") == 2
    assert "not nats" in capsys.readouterr().err
    assert not (tmp_path / "gpr.html").exists()
    mine = write(load_circuit("macaque", 3), tmp_path / "mine.toml")
    assert run("page", tmp_path / "mine.html", "--circuit", mine) == 0
    assert (tmp_path / "mine.html").read_text() == page(mine)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_browser_says_what_the_script_computes(tmp_path):
    quickjs = pytest.importorskip("quickjs")
    # As many trials take minutes in the slow engine: fewer are the same script.
    text = page("macaque").replace("trials: 300", "trials: 12")
    path = tmp_path / "circuit.html"
    path.write_text(text)
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"]
    command += ["--no-first-run", "--disable-background-networking", "--disable-component-update"]
    command += ["--disable-sync", f"--user-data-dir={tmp_path}/p"]
    command += ["--virtual-time-budget=20000", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True).stdout
    said = re.search(r'<p id="said"[^>]*>([^<]*)</p>', done)[1]
    context = quickjs.Context()
    for script in re.findall(r"<script>(.*?)</script>", text, re.DOTALL)[:2]:
        context.eval(script)
    task = {"seed": 2024, "trials": 12, "readings": 40, "dPrime": 0.5, "conflict": 0}
    call = f"decided(walks(2, {json.dumps(task)}), circuitOut(TABLES['2']), -Math.log(0.82))"
    found = json.loads(context.eval(f"JSON.stringify({call})"))
    want = f"{found['decided']} of 12 trials decided within 2000 ms; accuracy "
    want += f"{found['accuracy']:.2f} and mean time {found['readings'] * 50:.0f} ms of these"
    assert said.startswith(f"The circuit as changed: {want}.\nIntact: {want}.\n")
    assert re.search(r'<p id="warning" role="alert"></p>', done)
    assert done.count("<rect") >= 6 * 3
