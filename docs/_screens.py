"""Pictures of the explorer for its tutorial; ``python docs/_screens.py`` makes them anew."""

import io
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, TimeoutError, sync_playwright

FOLDER = Path(__file__).parent / "tutorials"
COLOURS = 48
WIDE, HIGH, PHONE = 1400, 4000, 400
"""Sizes of the window: the page scrolls within it, so that it is as high as the page."""
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


def enter(page: Page, label: str, text: str) -> None:
    """Fill a field as a user does, and wait until the page has computed its panels."""
    field = page.get_by_label(label, exact=True)
    field.fill(text)
    field.press("Enter")
    settled(page)


def settled(page: Page) -> None:
    """Wait until the page has begun to compute, and then until it is up to date."""
    with suppress(TimeoutError):  # a state that is shown already takes no time
        page.get_by_text("Computing…").first.wait_for(timeout=8000)
    page.get_by_text("Up to date.").first.wait_for()
    page.wait_for_timeout(1500)


def saved(page: Page, name: str, left: int, high: int, top: int = 0) -> None:
    """Write the upper part of the page, from a column and a row on, to a file with few colours."""
    whole = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    written(whole.crop((left, top, whole.width, high)), name)


def panel(page: Page, name: str, title: str) -> None:
    """Write one panel of the page."""
    card = page.locator(".card", has_text=re.compile(rf"^\s*{re.escape(title)}")).first
    written(Image.open(io.BytesIO(card.screenshot())).convert("RGB"), name)


def written(picture: Image.Image, name: str) -> None:
    """Write a picture to a small file with few colours."""
    # Few pixels are orange: the usual choice of colours would turn them brown.
    every = Image.Quantize.MAXCOVERAGE
    small = picture.quantize(COLOURS, method=every, kmeans=2, dither=Image.Dither.NONE)
    small.save(FOLDER / f"explore_{name}.png", optimize=True)


def lesions(page: Page) -> None:
    """Take a lesion that makes decisions faster, and one that slows them."""
    enter(page, "Lesion: cells lost (%)", "10")
    saved(page, "lesion", 0, 1180)
    again(page)
    enter(page, "New edit (then Enter)", "lesion D1 10%")
    panel(page, "lesion_d1", "Behaviour")
    again(page)
    page.get_by_role("button", name="Rank losses of 10 %").click()
    page.get_by_text("Each loss alone").wait_for()
    panel(page, "ranking", "Which loss slows decisions?")


def conflict(page: Page) -> None:
    """Take the first loss under conflict, and an additional one of D1."""
    again(page)
    enter(page, "Conflict (0 none, below 1)", "0.7")
    enter(page, "New edit (then Enter)", "lesion STN 5%")
    panel(page, "conflict_stn", "Behaviour")
    page.get_by_role("button", name="Use the edited circuit as the control").click()
    settled(page)
    enter(page, "New edit (then Enter)", "lesion D1 10%")
    saved(page, "conflict", 0, 1000)


def dopamine(page: Page) -> None:
    """Take the warning of an oscillation, and a trial that has it."""
    again(page)
    enter(page, "New edit (then Enter)", "dopamine 0.1")
    saved(page, "dopamine", 0, 860, top=70)  # without the bar above
    panel(page, "dopamine_trial", "One trial in spikes")


def again(page: Page) -> None:
    """Show the first state."""
    page.get_by_role("button", name="Reset").click()
    settled(page)


def series(page: Page) -> None:
    """Take the pictures of the tutorial, in its order: a series for each question, and a phone."""
    settled(page)
    lesions(page)
    conflict(page)
    dopamine(page)
    again(page)
    enter(page, "New edit (then Enter)", "lesion STN 10%")
    page.set_viewport_size({"width": PHONE, "height": HIGH})
    page.wait_for_timeout(1500)
    saved(page, "phone", 0, 1500)


def main() -> None:
    """Start the explorer, and drive it in a browser without a window."""
    command = [sys.executable, "-m", "bgmodel", "explore", "--port", "0", "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": WIDE, "height": HIGH})
            page.set_default_timeout(180_000)
            page.goto(address)
            series(page)
            browser.close()
    finally:
        process.terminate()


if __name__ == "__main__":
    main()
