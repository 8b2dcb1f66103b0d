"""The command that opens the interactive explorer."""

from __future__ import annotations

import gc
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Annotated

from bgmodel.commands.options import OFF
from bgmodel.support.entry import Entry

PORT = 5006
NEEDS = 'the explorer needs Panel: pip install "bgmodel[explore]"'


def explore(file: str = "", /, *, port: int = PORT, browser: Annotated[bool, OFF] = True) -> None:
    """Open a circuit in the browser: edit it, and see it fire, decide and behave.

    The page is served to this machine only, at an address with a secret token; Ctrl-C ends it.

    Examples: bgmodel explore; bgmodel explore mine.toml; bgmodel explore stn_conflict --port 0

    Parameters
    ----------
    file
        A circuit or an included experiment by name, a .toml file of either, or a link from the
        explorer; by default the macaque circuit.
    port
        Port of the page; 0 for any that is free.
    browser
        Whether to open the page in the browser.
    """
    if find_spec("panel") is None:
        raise ImportError(NEEDS)
    with _without_collections():
        from bgmodel.explorer.state import opened

        entry, state = Entry.at(port), opened(file)
        state.check()
        print(f"bgmodel explorer: {entry.address}", flush=True)
        print("It is for this machine only; Ctrl-C ends it.", file=sys.stderr, flush=True)
        if browser:
            threading.Thread(target=_open, args=(entry.address,), daemon=True).start()
        from bgmodel.explorer.server import Served  # the browser starts meanwhile
    Served(state, entry).run()


@contextmanager
def _without_collections() -> Iterator[None]:
    """Suspend garbage collection within the block.

    Imports create thousands of lasting objects: to look for garbage among them takes a fifth of
    their time.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _open(address: str) -> None:
    """Open an address in the browser, or say that there is none."""
    if not webbrowser.open(address):
        print("bgmodel: no browser was found: open the address above", file=sys.stderr)
