"""The command that opens the interactive explorer."""

from __future__ import annotations

import sys
import threading
import webbrowser
from importlib.util import find_spec
from typing import Annotated

from bgmodel.commands.options import OFF
from bgmodel.commands.output import say


def explore(file: str = "", /, *, port: int = 5006, browser: Annotated[bool, OFF] = True) -> None:
    """Open a circuit in the browser: edit it, and watch its spikes, decisions and behaviour.

    The page is served to this machine only, at an address that contains a secret; Ctrl-C ends it.

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
        raise ImportError('the explorer needs Panel: pip install "bgmodel[explore]"')
    from bgmodel.explorer.state import opened

    state = opened(file)
    state.check()
    from bgmodel.explorer.server import Served

    served = Served(state, port)
    print(f"bgmodel explorer: {served.address}", flush=True)
    print("It is for this machine only; Ctrl-C ends it.", file=sys.stderr, flush=True)

    def show() -> None:
        if not webbrowser.open(served.address):
            say("no browser was found: open the address above")

    if browser:
        threading.Thread(target=show, daemon=True).start()
    served.run()
