"""The address of a page that only this user can open."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass

from circuits.errors import InputError, require

HOST = "127.0.0.1"
TOKEN = "token"
"""Name of the part of an address that contains the secret."""
WAITING = 64
"""Number of connections that may wait until the server is ready."""


@dataclass(frozen=True)
class Entry:
    """A listening port of this machine and a secret; browsers may connect before a server runs."""

    listener: socket.socket
    token: str

    @classmethod
    def at(cls, port: int) -> Entry:
        """Listen on a port, or on any free one for 0, with a new secret."""
        require(0 <= port < 65536, "port", "must be within 0..65535", port)
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
        except OSError:
            listener.close()
            reason = f"port {port} is in use: give another one, or 0 for any that is free"
            raise InputError(reason, "port", port) from None
        listener.setblocking(False)
        listener.listen(WAITING)
        return cls(listener, secrets.token_urlsafe(24))

    @property
    def port(self) -> int:
        """The port."""
        return int(self.listener.getsockname()[1])

    @property
    def root(self) -> str:
        """The address without the secret."""
        return f"http://{HOST}:{self.port}/"

    @property
    def address(self) -> str:
        """The address to open, with the secret."""
        return f"{self.root}?{TOKEN}={self.token}"
