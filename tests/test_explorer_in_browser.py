"""The explorer in a real browser: its numbers are those of `bgmodel experiment`."""

import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest

from bgmodel.explorer.html import TITLES
from bgmodel.explorer.rows import EXAMPLES
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
EXAMPLE = "course: a nucleus has more input from a time on"
EVERY = "els => els.map(e => [e.dataset.key, e.dataset.circuit])"


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
        page.on("console", lambda said: wrong.append(said.text) if said.type in LOUD else None)
        page.on("request", lambda asked: wrong.append(asked.url) if elsewhere(asked.url) else None)
        page.goto(command[0])
        yield page
        browser.close()
    assert wrong == []


def elsewhere(url):
    return not url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:"))


def shown(page, before=None):
    """Wait until all panels show one state, another than before; return its key and its hash."""
    page.wait_for_function(
        """([count, before]) => {
            const found = [];
            const look = (root) => root.querySelectorAll("*").forEach((e) => {
                if (e.dataset && e.dataset.key) found.push(e.dataset.key);
                if (e.shadowRoot) look(e.shadowRoot);
            });
            look(document);
            return found.length === count && new Set(found).size === 1 && found[0] !== before;
        }""",
        arg=[len(TITLES), before],
    )
    ((key, circuit),) = set(map(tuple, page.locator("[data-key]").evaluate_all(EVERY)))
    return key, circuit


def enter(page, label, text):
    field = page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")


def test_a_user_edits_sees_each_panel_change_and_takes_the_experiment_along(page, tmp_path, capsys):
    key, first = shown(page)
    file = tmp_path / "mine.toml"
    file.write_text(small("macaque", "population").experiment.to_toml())
    enter(page, "Or a file of either (.toml), or a link", str(file))
    key, loaded = shown(page, key)
    assert loaded == first
    enter(page, "Lesion: cells lost (%)", "10")
    key, lesioned = shown(page, key)
    page.get_by_text("Add a pathway").first.click()
    page.get_by_label("From", exact=True).select_option("D1")
    page.get_by_label("To", exact=True).select_option("GPe")
    page.get_by_role("button", name="Add pathway").click()
    key, added = shown(page, key)
    enter(page, "Alternatives N", "3")
    key, three = shown(page, key)
    assert len({first, lesioned, added, three}) == 4
    text = page.get_by_label("The experiment's file (TOML)").input_value()
    copied = tmp_path / "copied.toml"
    copied.write_text(text)
    capsys.readouterr()
    assert run("experiment", copied, "--workers", 1) == 0
    printed = capsys.readouterr().out
    compare(page, printed)
    state = State.from_link(page.get_by_label("Link", exact=True).input_value())
    assert state.digest == three
    assert state.edits == ("lesion STN 10%", "add D1->GPe weight=-0.1 delay_ms=4")
    refuse(page, capsys)
    rank(page)
    with_keys(page, key)
    from_an_example(page)
    by_keyboard(page)
    on_a_phone(page)


def compare(page, printed):
    """Compare the table on the screen with the numbers that the command printed."""
    rows = page.get_by_label("Behaviour", exact=True).locator("tbody tr")
    texts = rows.evaluate_all(
        "rows => rows.map(r => [r.querySelector('th').title, ...[...r.querySelectorAll('td')]"
        ".map(c => c.textContent)])"
    )
    printed_rows = [row for row in texts if re.search(rf"^{row[0]} ", printed, re.MULTILINE)]
    assert len(printed_rows) > 6
    for measure, *cells in printed_rows:
        line = re.search(rf"^{measure} .*$", printed, re.MULTILINE)[0]
        assert line.split()[1:] == " ".join(cells).split()


def refuse(page, capsys):
    """Make a wrong edit: it is refused in the command's sentence, which is shown as text."""
    before = page.locator("[data-key]").evaluate_all(EVERY)
    line = "lesion <b>STM</b> 10%"
    enter(page, "New edit (then Enter)", line)
    text = page.get_by_role("alert").first.inner_text()
    assert run("circuit", "show", "--task", "channels=3", "--edits", line) == 2
    sentence = capsys.readouterr().err.strip().removeprefix("bgmodel: ")
    assert text == f"Refused: {sentence}"
    assert page.locator("[data-key]").evaluate_all(EVERY) == before
    field = page.get_by_label("New edit (then Enter)", exact=True)
    assert field.input_value() == line
    below = page.get_by_role("alert").bounding_box()["y"] - field.bounding_box()["y"]
    assert 0 < below < 100


def with_keys(page, key):
    """Each key that moves a number applies it: the behaviour panel shows another circuit."""
    field = page.get_by_label("Dopamine level (1 is normal)", exact=True)
    field.focus()
    seen = set()
    for pressed, level in (("ArrowDown", "0.95"), ("PageDown", "0.45"), ("ArrowUp", "0.5")):
        page.keyboard.press(pressed)
        key, circuit = shown(page, key)
        assert field.input_value() == level
        assert circuit not in seen
        seen.add(circuit)


def from_an_example(page):
    """Choose an example, which fills the field; Enter applies it as it stands."""
    key, before = shown(page)
    page.get_by_label("Examples of edits", exact=True).select_option(label=EXAMPLE)
    field = page.get_by_label("New edit (then Enter)", exact=True)
    expect_value(page, field, EXAMPLES[EXAMPLE])
    field.press("Enter")
    key, after = shown(page, key)
    assert after != before
    state = State.from_link(page.get_by_label("Link", exact=True).input_value())
    assert EXAMPLES[EXAMPLE] in state.edits


def expect_value(page, field, value):
    page.wait_for_function("([e, text]) => e.value === text", arg=[field.element_handle(), value])


def test_a_page_says_that_its_command_has_ended(command):
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(WAIT_MS)
        page.goto(command[0])
        page.locator("[data-key]").first.wait_for()
        assert page.get_by_role("alert").count() == 0
        command[1].send_signal(signal.SIGINT)
        page.get_by_role("alert").wait_for()
        browser.close()


def rank(page):
    """Rank the losses until the ranking is stopped."""
    page.get_by_role("button", name="Rank losses of 10 %").click()
    ranking = page.get_by_label("Which loss slows decisions?")
    ranking.locator("tbody tr").nth(2).wait_for()
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="Rank losses of 10 %", disabled=False).wait_for()


FOCUSED = """() => {
    let e = document.activeElement;
    while (e.shadowRoot && e.shadowRoot.activeElement) e = e.shadowRoot.activeElement;
    const label = e.labels && e.labels.length ? e.labels[0].textContent : "";
    const named = e.getAttribute("aria-label") || label || e.textContent;
    const ring = getComputedStyle(e);
    return [e.tagName, named.trim(), ring.outlineStyle === "none" ? "0px" : ring.outlineWidth];
}"""
ON_THE_WAY = [
    *("To the results", "To the settings", "Undo", "Reset", "New edit (then Enter)"),
    *("Dopamine level (1 is normal)", "Lesion: cells lost (%)", "Alternatives N", "Save as SVG"),
    *("Trial shown in spikes", "Trials (CSV)", "The experiment's file (TOML)", "Link"),
]
"""Some of what the Tab key reaches, in this order."""


def by_keyboard(page):
    """Tab from the top to the end: all that is reached has a name, and shows that it is reached."""
    page.locator(".skip").first.focus()
    page.wait_for_timeout(1200)
    reached = [page.evaluate(FOCUSED)]
    for _ in range(120):
        page.keyboard.press("Tab")
        reached.append(page.evaluate(FOCUSED))
        if reached[-1][0] == "BODY":
            break
    assert reached.pop()[0] == "BODY"
    names = [name for _, name, _ in reached]
    assert all(names)
    assert [tag for tag, _, ring in reached if ring == "0px"] == []
    assert sorted(ON_THE_WAY, key=names.index) == ON_THE_WAY


def on_a_phone(page):
    """At 400 pixels no element is wider than the screen, and every field has a label."""
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    fields = page.locator("input, select, textarea")
    named = fields.evaluate_all(
        "els => els.map(e => !!(e.labels && e.labels.length) || !!e.getAttribute('aria-label')"
        " || e.type === 'submit')"
    )
    assert len(named) > 20
    assert all(named)
