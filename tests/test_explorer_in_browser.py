"""The explorer in a real browser: its numbers are those of `bgmodel experiment`."""

import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest

from bgmodel.explorer.panels import TITLES
from bgmodel.explorer.state import State
from tests.explorer.helpers import small
from tests.helpers import run

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = [
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(BROWSER is None, reason=f"there is no browser: {', '.join(BROWSERS)}"),
    pytest.mark.skipif(
        not (find_spec("panel") and find_spec("playwright")),
        reason="the browser is driven by Playwright: pip install '.[explore,browser]'",
    ),
]
WAIT_MS = 120_000
LOUD = ("error", "warning")
HARMLESS = "software WebGL"
"""A notice of browsers without a graphics card."""


@pytest.fixture
def command(tmp_path):
    """Start the command; yield its address and its process, and end it as Ctrl-C does."""
    words = [sys.executable, "-m", "bgmodel", "explore", "--port", "0", "--no-browser"]
    process = subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    try:
        yield re.search(r"http://\S+", process.stdout.readline())[0], process
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        errors = process.communicate(timeout=60)[1]
        assert process.returncode == 0
        assert "Traceback" not in errors
    finally:
        process.kill()


@pytest.fixture
def page(command):
    """Open the page; afterwards it has had no error and has asked no other machine."""
    from playwright.sync_api import sync_playwright

    wrong = []
    with sync_playwright() as driver:
        # Chromium's sandbox does not start as root, as in many containers.
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(WAIT_MS)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda message: wrong.append(message.text) if loud(message) else None)
        page.on("request", lambda asked: wrong.append(asked.url) if elsewhere(asked.url) else None)
        page.goto(command[0])
        yield page
        browser.close()
    assert wrong == []


def loud(message):
    return message.type in LOUD and HARMLESS not in message.text


def elsewhere(url):
    return not url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:"))


def shown(page, before=""):
    """Wait until all panels show one state, another than before; return its link."""
    link = page.get_by_label("Link", exact=True)
    changed = "([e, before]) => e.value && e.value !== before"
    page.wait_for_function(changed, arg=[link.element_handle(), before])
    page.get_by_text("Up to date.").first.wait_for()
    titles = page.get_by_text(re.compile(r" \(circuit [0-9a-f]{8}\)$")).all_inner_texts()
    text = link.input_value()
    digest = State.from_link(text).digest[:8]
    assert sorted(titles) == sorted(f"{title} (circuit {digest})" for title in TITLES.values())
    return text


def enter(page, label, text):
    field = page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")


def test_a_user_edits_sees_each_panel_change_and_takes_the_experiment_along(page, tmp_path, capsys):
    link = shown(page)
    file = tmp_path / "mine.toml"
    file.write_text(small("macaque", "population").experiment.to_toml())
    enter(page, "Or a file of either (.toml), or a link", str(file))
    link = shown(page, link)
    enter(page, "Lesion: cells lost (%)", "10")
    link = shown(page, link)
    enter(page, "New edit (then Enter)", "add D1->GPe weight=-0.1 delay_ms=4")
    link = shown(page, link)
    enter(page, "Alternatives N", "3")
    link = shown(page, link)
    state = State.from_link(link)
    assert state.edits == ("lesion STN 10%", "add D1->GPe weight=-0.1 delay_ms=4")
    copied = tmp_path / "copied.toml"
    copied.write_text(page.get_by_label("The experiment's file (TOML)").input_value())
    capsys.readouterr()
    assert run("experiment", copied, "--workers", 1) == 0
    compare(page, capsys.readouterr().out)
    refuse(page, capsys, link)


def compare(page, printed):
    """Compare the table on the screen with the numbers that the command printed."""
    rows = page.locator("table", has_text="Mean decision time").locator("tbody tr")
    cells = rows.evaluate_all("rows => rows.map(r => [...r.cells].map(c => c.textContent))")
    lines = [" ".join(line.split()[1:]) for line in printed.splitlines()]
    compared = [cell for cell in cells if " ".join(cell[1:]) in lines]
    assert len(compared) > 6


def refuse(page, capsys, link):
    """Make a wrong edit: it is refused in the command's sentence, which is shown as text."""
    line = "lesion <b>STM</b> 10%"
    enter(page, "New edit (then Enter)", line)
    alert = page.get_by_role("alert").first.inner_text()
    assert run("circuit", "show", "--task", "channels=3", "--edits", line) == 2
    sentence = capsys.readouterr().err.strip().removeprefix("bgmodel: ")
    assert alert == f"Refused: {sentence}"
    assert page.get_by_label("Link", exact=True).input_value() == link
    field = page.get_by_label("New edit (then Enter)", exact=True)
    assert field.input_value() == line
    below = page.get_by_role("alert").bounding_box()["y"] - field.bounding_box()["y"]
    assert 0 < below < 100
