"""The explorer's server: nobody gets in without the token, and nothing else is served."""

import http.client
import socket
import threading
import time
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest

pytest.importorskip("panel", reason="the explorer needs Panel: pip install '.[explore]'")

from bgmodel.explorer.runs import PanelRuns
from bgmodel.explorer.server import HOST, Served
from tests.explorer.helpers import small

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def served():
    """Serve a small state in a thread."""
    ready, servers = threading.Event(), []

    def serve():
        import asyncio

        asyncio.set_event_loop(asyncio.new_event_loop())
        servers.append(Served(small("bogacz_gurney")))
        servers[0].server.start()
        ready.set()
        servers[0].server.io_loop.start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert ready.wait(60)
    yield servers[0]
    loop = servers[0].server.io_loop
    loop.add_callback(servers[0].server.stop)
    loop.add_callback(loop.stop)
    thread.join(20)
    assert not thread.is_alive()


def answer(served, path, **headers):
    """Return the status, the headers and the text of an answer."""
    connection = http.client.HTTPConnection(HOST, served.port, timeout=60)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    return response.status, response.headers, response.read().decode(errors="replace")


SOCKET = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Protocol": "bokeh, none",
}


@pytest.mark.parametrize("query", ["", "token=", "token=wrong", "token=%C3%A9"])
@pytest.mark.parametrize("path", ["", "ws", "metadata", "autoload.js"])
def test_without_the_token_there_is_403(served, path, query):
    headers = SOCKET | {"Origin": served.root.rstrip("/")} if path == "ws" else {}
    status, _, text = answer(served, f"/{path}?bokeh-autoload-element=a&{query}", **headers)
    assert status == 403
    assert served.token not in text


def test_with_the_token_there_is_a_page_and_a_cookie_for_the_rest(served):
    at = urlsplit(served.address)
    status, headers, text = answer(served, f"/?{at.query}")
    assert status == 200
    assert "<title>bgmodel explorer</title>" in text
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    status, _, _ = answer(served, "/", Cookie=cookie.partition(";")[0])
    assert status == 200
    assert answer(served, "/", Cookie="bgmodel=1")[0] == 403


def test_everything_that_the_page_loads_is_from_this_machine(served):
    _, _, text = answer(served, f"/?{urlsplit(served.address).query}")
    for marker in ('src="http', "src='http", 'href="http', "//cdn", "//unpkg"):
        assert marker not in text


def test_a_socket_from_another_page_is_refused_even_with_the_token(served):
    query = urlsplit(served.address).query
    assert answer(served, f"/ws?{query}", **SOCKET, Origin="http://evil.example")[0] == 403


@pytest.mark.parametrize(
    "path",
    [
        "/etc/passwd", "/../../etc/passwd", "/static/../../../../etc/passwd",
        "/static/%2e%2e/%2e%2e/%2e%2e/server.py", "/bgmodel/__init__.py",
        "/static/extensions/panel/../../../../../../etc/passwd", "/components/os/x",
    ],
)  # fmt: skip
def test_other_files_are_not_served(served, path):
    status, _, text = answer(served, f"{path}?{urlsplit(served.address).query}")
    assert status in (400, 403, 404)
    assert "root:" not in text


def test_it_listens_to_this_machine_alone(served):
    with socket.socket() as probe:
        other = socket.gethostbyname(socket.gethostname())
        if other.startswith("127."):
            pytest.skip("this machine has no other address")
        assert probe.connect_ex((other, served.port)) != 0


def test_an_interrupted_server_waits_for_the_run_that_it_cancels():
    """A run in a thread fails with a traceback if Python ends before it."""
    runs, begun, ended = PanelRuns(print, print), threading.Event(), []

    def panels():
        begun.set()
        time.sleep(0.2)
        ended.append(True)
        yield from ()

    runs._submit(small("bogacz_gurney"), panels)
    assert begun.wait(60)
    server = SimpleNamespace(run_until_shutdown=lambda: None)
    Served.run(SimpleNamespace(server=server, explorers=[runs]))
    assert ended
