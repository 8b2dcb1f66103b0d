"""The command that opens the interactive explorer."""

from __future__ import annotations

from dataclasses import dataclass

from tyro.conf import Positional

PORT = 5006
NEEDS = 'the explorer needs Panel: pip install "bgmodel[explore]"'


@dataclass(frozen=True)
class Explore:
    """Open a circuit in the browser: edit it, and see it fire, decide and behave.

    The page is served to this machine only, at an address with a secret token; Ctrl-C ends it.

    Examples: bgmodel explore; bgmodel explore mine.toml; bgmodel explore stn_conflict --port 0
    """

    file: Positional[str] = ""
    """A circuit or an included experiment by name, a .toml file of either, or a link from the
    explorer; by default the macaque circuit."""
    port: int = PORT
    """Port of the page; 0 for any that is free."""
    browser: bool = True
    """Whether to open the page in the browser."""

    def __call__(self) -> None:
        """Run the command."""
        from importlib.util import find_spec

        if find_spec("panel") is None:
            raise ImportError(NEEDS)
        from bgmodel.explorer.server import Served
        from bgmodel.explorer.state import opened

        Served(opened(self.file), self.port).run(browser=self.browser)
