"""The page: one file, whole, and what it says in a browser is what the script computes."""

import json
import re
import shutil
import subprocess

import pytest

from bgmodel.web.page import page
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


def test_the_command_writes_it_and_refuses_what_it_cannot_show(tmp_path, capsys):
    assert run("page", tmp_path / "circuit.html") == 0
    assert (tmp_path / "circuit.html").read_text() == page("macaque")
    assert "open it in a browser" in capsys.readouterr().out
    assert run("page", tmp_path / "circuit.txt") == 2
    assert run("page", tmp_path / "gpr.html", "--circuit", "gpr") == 2
    assert "not nats" in capsys.readouterr().err
    assert not (tmp_path / "gpr.html").exists()


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_browser_says_what_the_script_computes(tmp_path):
    quickjs = pytest.importorskip("quickjs")
    # As many trials take a minute in the slow engine: fewer are the same script.
    text = page("macaque").replace("trials: 300", "trials: 60")
    path = tmp_path / "circuit.html"
    path.write_text(text)
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path}/p",
    ]
    command += ["--virtual-time-budget=20000", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    said = re.search(r'<p id="said"[^>]*>([^<]*)</p>', done)[1]
    context = quickjs.Context()
    for script in re.findall(r"<script>(.*?)</script>", text, re.DOTALL)[:2]:
        context.eval(script)
    task = {"seed": 2024, "trials": 60, "readings": 40, "dPrime": 0.5, "conflict": 0}
    call = f"decided(walks(2, {json.dumps(task)}), circuitOut(TABLES['2']), -Math.log(0.82))"
    found = json.loads(context.eval(f"JSON.stringify({call})"))
    want = f"accuracy {found['accuracy']:.2f} after {found['readings'] * 50:.0f} ms"
    assert said.startswith(f"The circuit as changed: {want}. Intact: {want}.")
    assert re.search(r'<p id="warning" role="alert"></p>', done)
    assert done.count("<rect") >= 6 * 3
