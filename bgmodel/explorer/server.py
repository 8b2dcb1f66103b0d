"""The explorer's server: this machine only, and only with the token of its address."""

from __future__ import annotations

import hmac
import threading
from contextlib import suppress
from typing import Any

import panel as pn
from bokeh.events import ConnectionLost
from bokeh.models import CustomJS
from bokeh.server.auth_provider import AuthProvider
from tornado.web import HTTPError

from bgmodel.explorer.page import Explorer
from bgmodel.explorer.panels import Memory
from bgmodel.explorer.state import QUERY, State
from bgmodel.support.entry import HOST, TOKEN, Entry
from circuits.errors import quiet

CHECK_MS, UNUSED_MS = 5_000, 60_000
"""How often closed tabs are looked for, and how long a tab may take to open, ms: a page that is not
connected by then is taken for closed."""
LOST = """
if (!document.querySelector(".lost")) {
  const said = document.createElement("p");
  said.className = "lost";
  said.setAttribute("role", "alert");
  said.textContent = "The explorer's command has ended, so this page no longer changes. "
    + "Start bgmodel explore again; with the link of this state it opens here.";
  document.querySelector("header").append(said);
}
"""
"""What a page does when its server is gone."""


class Token(AuthProvider):
    """Lets in who has the token: from the address at first, then from a cookie."""

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


class Served:
    """A server of one state; each tab that opens its address has an explorer."""

    def __init__(self, state: State, entry: Entry) -> None:
        state.check()
        self.entry = entry
        self.explorers: list[Explorer] = []
        self._state, self._memory = state, Memory()
        self._server = pn.io.server.get_server(
            {"/": self._page},
            port=0,
            address=HOST,
            websocket_origin=[f"{HOST}:{entry.port}", f"localhost:{entry.port}"],
            title="bgmodel explorer",
            auth_provider=Token(entry.token, entry.port),
            start=False,
            show=False,
            check_unused_sessions_milliseconds=CHECK_MS,
            unused_session_lifetime_milliseconds=UNUSED_MS,
        )

    @quiet()  # the page shows them
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
        explorer = Explorer(state, self.entry.root, doc.add_next_tick_callback, memory)
        if said:
            explorer.refuse(said)
        self.explorers.append(explorer)
        doc.js_on_event(ConnectionLost, CustomJS(code=LOST))

        def closed(_: Any) -> None:
            explorer.stop()
            self.explorers.remove(explorer)

        pn.state.on_session_destroyed(closed)
        return explorer.template()

    def run(self) -> None:
        """Serve until the command is interrupted."""
        self.start()
        threading.Thread(target=self.compute, args=(self._memory,), daemon=True).start()
        try:
            self.loop.start()
        finally:
            self._close()

    @property
    def loop(self) -> Any:
        """The event loop of the server."""
        return self._server.io_loop

    def start(self) -> None:
        """Take the connections of the entry; answers are given once the loop runs."""
        self._server.start()
        # Bokeh's server makes its own sockets: it listens on one more port, with the same token.
        self._server._http.add_socket(self.entry.listener)

    def end(self) -> None:
        """End the server and its loop."""
        self._close()
        self.loop.stop()

    def _close(self) -> None:
        for explorer in self.explorers:
            explorer.stop()
        self._server.stop()

    def compute(self, memory: Memory) -> None:
        """Run the first state, which also loads the engine; its page shows what is refused."""
        with suppress(ValueError), quiet():
            given = memory.given(self._state)
            self._state.experiment.run(workers=2, given=given, kept=memory.conditions)
