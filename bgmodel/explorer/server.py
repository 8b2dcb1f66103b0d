"""The explorer's server: this machine only, and only with the token of its address."""

from __future__ import annotations

import hmac
import secrets
import socket
import sys
import threading
import warnings
import webbrowser
from contextlib import suppress
from typing import Any

import panel as pn
from bokeh.server.auth_provider import AuthProvider
from tornado.web import HTTPError

from bgmodel.explorer.page import Explorer
from bgmodel.explorer.panels import Memory, kept_warnings
from bgmodel.explorer.state import QUERY, State
from circuits.errors import BgmodelWarning, InputError, require

HOST = "127.0.0.1"
PORT = 5006
TOKEN = "token"
CHECK_MS, UNUSED_MS = 5_000, 60_000
"""How often closed tabs are looked for, and how long a tab may take to open, ms: a page that is not
connected by then is taken for closed."""


class Token(AuthProvider):
    """Lets in who has the token: from the address at first, then from a cookie.

    Parameters
    ----------
    token : str
        The secret.
    port : int
        The server's port: cookies of one machine are shared by its ports.
    """

    def __init__(self, token: str, port: int) -> None:
        self._token, self._cookie = token, f"bgmodel-{port}"
        super().__init__()

    @property
    def get_user(self) -> Any:
        """Return the function that checks a request; it answers 403 without the token."""
        return self._user

    @property
    def login_url(self) -> str:
        """Return an address that Bokeh requires; it is never used."""
        return "/none"

    def _user(self, handler: Any) -> str:
        given = handler.get_argument(TOKEN, "")
        if self._right(given):
            handler.set_cookie(self._cookie, given, httponly=True, samesite="Strict")
        elif not self._right(handler.get_cookie(self._cookie, "")):
            raise HTTPError(403, reason="Open the address that the command printed")
        return "user"

    def _right(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def free_port(wanted: int) -> int:
    """Return a port to serve on: the wanted one, or any free one for 0.

    Raises
    ------
    ValueError
        If it is no port, or in use.
    """
    require(0 <= wanted < 65536, "port", "must be within 0..65535", wanted)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, wanted))
        except OSError:
            said = f"port {wanted} is in use: give another one, or 0 for any that is free"
            raise InputError(said, "port", wanted) from None
        return int(probe.getsockname()[1])


class Served:
    """A server of one state; each tab that opens its address has an explorer.

    Parameters
    ----------
    state : State
        The first state of every tab.
    port : int
        The port; 0 for any that is free.
    """

    def __init__(self, state: State, port: int = PORT) -> None:
        state.check()
        self.port, self.token = free_port(port), secrets.token_urlsafe(24)
        self.explorers: list[Explorer] = []
        self._state, self._memory = state, Memory()
        self._server = pn.io.server.get_server(
            {"/": self._page},
            port=self.port,
            address=HOST,
            websocket_origin=[f"{HOST}:{self.port}", f"localhost:{self.port}"],
            title="bgmodel explorer",
            auth_provider=Token(self.token, self.port),
            start=False,
            show=False,
            check_unused_sessions_milliseconds=CHECK_MS,
            unused_session_lifetime_milliseconds=UNUSED_MS,
        )

    @property
    def root(self) -> str:
        """The address without the token."""
        return f"http://{HOST}:{self.port}/"

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        return f"{self.root}?{TOKEN}={self.token}"

    def _page(self) -> Any:
        """Return the page of a new tab."""
        doc = pn.state.curdoc
        said = ""
        state = self._state
        code = pn.state.location.search if pn.state.location else ""
        if f"{QUERY}=" in code:
            try:
                state = State.from_link(code)
                state.check()
            except (ValueError, OSError) as error:
                state, said = self._state, str(error)
        # The first tab finds what was computed while the browser started.
        memory, self._memory = self._memory, Memory()
        explorer = Explorer(state, self.root, doc.add_next_tick_callback, memory)
        if said:
            explorer.refuse(said)
        self.explorers.append(explorer)

        def closed(_: Any) -> None:
            explorer.stop()
            self.explorers.remove(explorer)

        pn.state.on_session_destroyed(closed)
        return explorer.template()

    def run(self, *, browser: bool) -> None:
        """Serve until the command is interrupted.

        Parameters
        ----------
        browser : bool
            Whether to open the page in the browser.
        """
        warnings.simplefilter("ignore", BgmodelWarning)  # the page shows them
        self.start()
        print(f"bgmodel explorer: {self.address}", flush=True)
        print("It is for this machine only; Ctrl-C ends it.", file=sys.stderr, flush=True)
        threading.Thread(target=self.compute, args=(self._memory,), daemon=True).start()
        if browser:
            threading.Thread(target=self._open, daemon=True).start()
        try:
            self.loop.start()
        finally:
            self._close()

    @property
    def loop(self) -> Any:
        """The event loop of the server."""
        return self._server.io_loop

    def start(self) -> None:
        """Listen; answers are given once the loop runs."""
        self._server.start()

    def end(self) -> None:
        """End the server and its loop."""
        self._close()
        self.loop.stop()

    def _close(self) -> None:
        for explorer in self.explorers:
            explorer.stop()
        self._server.stop()

    def compute(self, memory: Memory) -> None:
        """Run the first state, which also loads the engine; its page shows what is refused.

        Parameters
        ----------
        memory : Memory
            Receives the results.
        """
        with suppress(ValueError), kept_warnings():
            given = memory.given(self._state)
            self._state.experiment.run(workers=2, given=given, kept=memory.conditions)

    def _open(self) -> None:
        if not webbrowser.open(self.address):
            print("bgmodel: no browser was found: open the address above", file=sys.stderr)
