"""The explorer's server: for this machine only, and only with the secret of its address."""

from __future__ import annotations

import hmac
import secrets
import socket
from typing import Any

import panel as pn
from bokeh.server.auth_provider import AuthProvider
from tornado.web import HTTPError

from bgmodel.explorer.page import Explorer
from bgmodel.explorer.state import QUERY, ExplorerState
from circuits.errors import InputError, quiet, require

HOST = "127.0.0.1"
TOKEN = "token"
"""Name of the part of an address that contains the secret."""
CHECK_MS, UNUSED_MS = 5_000, 60_000
"""Interval between searches for closed tabs, and the time after which a tab without a connection
counts as closed, ms."""
LOST = (
    "The command has ended, so this page no longer changes. Start bgmodel explore again, and open "
    "the link of this state there."
)
"""Message of a page whose server has ended."""


class Token(AuthProvider):
    """Admits requests with the secret, in the address at first and then in a cookie."""

    def __init__(self, token: str, port: int) -> None:
        self._token, self._cookie = token, f"bgmodel-{port}"
        super().__init__()

    @property
    def get_user(self) -> Any:
        """The function that checks a request, and answers 403 without the secret."""
        return self._user

    @property
    def login_url(self) -> str:
        """An address that Bokeh requires; it is never used."""
        return "/none"

    def _user(self, handler: Any) -> str:
        token = handler.get_argument(TOKEN, "")
        if self._right(token):
            handler.set_cookie(self._cookie, token, httponly=True, samesite="Strict")
        elif not self._right(handler.get_cookie(self._cookie, "")):
            raise HTTPError(403, reason="Open the address that the command printed")
        return "user"

    def _right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())


def free_port(port: int) -> int:
    """Return a port of this machine that is free: the given one, or any for 0."""
    require(0 <= port < 65536, "port", "must be within 0..65535", port)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            message = f"port {port} is in use: give another one, or 0 for any that is free"
            raise InputError(message, "port", port) from None
        return int(probe.getsockname()[1])


class Served:
    """A server of a state; each tab that opens its address has its own explorer."""

    def __init__(self, state: ExplorerState, port: int = 0) -> None:
        self.port, self.token = free_port(port), secrets.token_urlsafe(24)
        self.root = f"http://{HOST}:{self.port}/"
        self.address = f"{self.root}?{TOKEN}={self.token}"
        self.explorers: list[Explorer] = []
        self._state = state
        self.server = pn.serve(
            {"/": self._page},
            port=self.port,
            address=HOST,
            websocket_origin=[f"{HOST}:{self.port}", f"localhost:{self.port}"],
            title="bgmodel explorer",
            auth_provider=Token(self.token, self.port),
            start=False,
            show=False,
            verbose=False,
            check_unused_sessions_milliseconds=CHECK_MS,
            unused_session_lifetime_milliseconds=UNUSED_MS,
        )

    @quiet()  # the page shows warnings
    def _page(self) -> Any:
        """Return the page of a new tab."""
        pn.extension(notifications=True, disconnect_notification=LOST)
        state, refused = self._state, ""
        query = pn.state.location.search if pn.state.location else ""
        if f"{QUERY}=" in query:
            try:
                state = ExplorerState.from_link(query)
                state.check()
            except (ValueError, OSError) as error:
                state, refused = self._state, str(error)
        explorer = Explorer(state, self.root, pn.state.curdoc.add_next_tick_callback)
        if refused:
            explorer.refuse(refused)
        self.explorers.append(explorer)

        def closed(_: Any) -> None:
            explorer.stop()
            self.explorers.remove(explorer)

        pn.state.on_session_destroyed(closed)
        return explorer.template()

    def run(self) -> None:
        """Serve until the command is interrupted."""
        try:
            self.server.run_until_shutdown()
        finally:
            for wait in (False, True):  # a run that continues while Python ends would fail
                for explorer in self.explorers:
                    explorer.stop(wait=wait)
