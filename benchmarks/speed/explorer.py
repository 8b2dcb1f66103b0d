"""How fast the explorer answers an edit, in a real browser: python -m benchmarks.speed.explorer.

The command is started as a user starts it, Chromium opens its address without a window, and edits
are typed into the page. ``--edits 200`` shows whether memory grows.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from typing import Any

import numpy as np
import psutil

PANELS = ("Behaviour", "Decision times", "Speed and accuracy", "One trial in spikes")
LAST = PANELS[-1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
COMMAND = [sys.executable, "-m", "bgmodel", "explore", "--port", "0", "--no-browser"]
WAIT_MS, LOOK_MS = 300_000, 5
HASH = """([title, before]) => {
    let hash = null;
    const look = (root) => root.querySelectorAll("*").forEach((e) => {
        const text = e.children.length ? "" : e.textContent;
        if (text.startsWith(`${title} (circuit `)) hash = text.slice(-9, -1);
        if (e.shadowRoot) look(e.shadowRoot);
    });
    look(document);
    return hash !== before ? hash : null;
}"""
"""Returns the hash of the circuit that a panel shows, unless it is the one before."""


def key_of(page: Any, title: str, before: str = "") -> str:
    """Wait until a panel shows another circuit, and return its hash."""
    handle = page.wait_for_function(HASH, arg=[title, before], polling=LOOK_MS)
    return str(handle.json_value())


class Server:
    """The command, and the resources that it has used so far."""

    def __init__(self) -> None:
        self.begun = time.perf_counter()
        started = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True)
        self.process = psutil.Process(started.pid)
        assert started.stdout is not None
        self.address = started.stdout.readline().split()[-1]

    @property
    def cpu_s(self) -> float:
        """CPU seconds of the command."""
        used = self.process.cpu_times()
        return used.user + used.system

    @property
    def memory_mb(self) -> float:
        """Memory in use (resident), MB."""
        return self.process.memory_info().rss / 1e6


def first_view(page: Any, server: Server) -> dict[str, tuple[float, float]]:
    """Open the page; return seconds, and CPU seconds, from the command to each part of it."""
    taken = {"Address": (time.perf_counter() - server.begun, server.cpu_s)}
    page.goto(server.address)
    page.get_by_label("New edit (then Enter)", exact=True).wait_for()
    taken["Controls"] = time.perf_counter() - server.begun, server.cpu_s
    for title in PANELS:
        key_of(page, title)
        taken[title] = time.perf_counter() - server.begun, server.cpu_s
    return taken


def edit(page: Any, server: Server, number: int) -> dict[str, float]:
    """Lesion STN; return seconds until each panel shows it, and CPU seconds until the last one."""
    field = page.get_by_label("New edit (then Enter)", exact=True)
    before = key_of(page, LAST)
    field.fill(f"lesion STN {5 + number * 0.1:.1f}%")
    begun, used = time.perf_counter(), server.cpu_s
    field.press("Enter")
    taken = {}
    for title in PANELS:
        key_of(page, title, before)
        taken[title] = time.perf_counter() - begun
        taken[f"{title}, CPU"] = server.cpu_s - used
    page.get_by_text("Up to date.").first.wait_for()
    return taken


def main() -> None:
    """Print the first view, the median time of edits, and the memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edits", type=int, default=20)
    edits = parser.parse_args().edits
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"there is no browser: {', '.join(BROWSERS)}")
    from playwright.sync_api import sync_playwright

    server = Server()
    rows, peak = [], 0.0
    try:
        with sync_playwright() as driver:
            # Chromium's sandbox does not start as root, as in many containers.
            window = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
            page = window.new_page(viewport={"width": 1400, "height": 900})
            page.set_default_timeout(WAIT_MS)
            for title, (wall, cpu) in first_view(page, server).items():
                print(f"first view, {title:<20}{wall:6.2f} s after the command, {cpu:.2f} CPU s")
            edit(page, server, -1)  # the first edit also imports and compiles
            for number in range(edits):
                rows.append(edit(page, server, number))
                peak = max(peak, server.memory_mb)
                if number + 1 in (1, 20, 50, 100, 150, edits):
                    print(f"after {number + 1:4} edits: {server.memory_mb:6.0f} MB", flush=True)
            window.close()
    finally:
        server.process.terminate()
    for title in PANELS:
        middle, used = (np.median([row[of] for row in rows]) for of in (title, f"{title}, CPU"))
        print(f"edit to {title:<20}{middle:6.2f} s (median of {edits}), {used:.2f} CPU s")
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    print(f"peak memory {peak:.0f} MB; load of the machine {load} on {os.cpu_count()} CPUs")


if __name__ == "__main__":
    main()
