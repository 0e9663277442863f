"""No service can send us elsewhere: what is redirected to another host goes nowhere."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Self

import pytest

from kb.core.config.settings import load_settings
from kb.core.errors import FatalError
from kb.net import retry
from kb.net.session import HttpSession, host_of, send
from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.inprocess import Here


class Elsewhere:
    """A server of somebody else, and what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, dict[str, str]]] = []
        asked = self.asked

        class Service(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                asked.append((self.path, dict(self.headers)))
                self.send_response(200)
                self.send_header("Content-Length", "2")
                self.end_headers()
                self.wfile.write(b"{}")

            do_POST = do_PUT = do_GET

            def log_message(self, *arguments: object) -> None:
                """Quiet."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Service)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))
        self.url = f"http://localhost:{self._server.server_port}/taken"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World()) as running:
        yield running


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> Iterator[Elsewhere]:
    monkeypatch.setattr(retry, "FIRST_S", 0.001)
    with Elsewhere() as running:
        yield running


CRAWL = ("crawl", "--limit", "1")


@pytest.mark.parametrize(
    ("source", "path", "code"),
    [
        ("youtube", "/youtube/v3/search", 4),
        ("reddit", "/api/v1/access_token", 1),
        ("reddit", "/r/", 1),
        ("wiki", "/api.php", 1),
    ],
    ids=["Data API", "Reddit's token", "Reddit's API", "MediaWiki's API"],
)
@pytest.mark.parametrize("status", [302, 307])
def test_a_service_that_leads_elsewhere_is_not_followed(
    sandbox: Sandbox,
    elsewhere: Elsewhere,
    here: Here,
    tmp_path: Path,
    source: str,
    path: str,
    code: int,
    status: int,
) -> None:
    sandbox.faults.clear()
    headers = {"Location": elsewhere.url}
    fault = sandbox.faults.add(path, service=source, status=status, times=None, headers=headers)
    settings = sandbox.settings() | {"KB_DATA": str(tmp_path / "data")}
    done = here(source, *CRAWL, env=settings)
    assert fault.hits > 0
    assert elsewhere.asked == []
    assert done.code == code, done.err
    assert "unexpected" not in done.err


def test_a_session_with_hosts_goes_nowhere_else(sandbox: Sandbox, elsewhere: Elsewhere) -> None:
    sandbox.faults.clear()
    sandbox.faults.add("/api.php", status=302, headers={"Location": elsewhere.url})
    root = sandbox.servers["wiki"].url
    with (
        HttpSession(load_settings(dotenv=False), hosts={host_of(root)}) as session,
        pytest.raises(FatalError, match="a service redirects to http://localhost"),
    ):
        send(session, "GET", f"{root}/api.php", headers={"Authorization": "Bearer ours"})
    assert elsewhere.asked == []


def test_where_any_host_will_do_no_credential_goes_along(
    sandbox: Sandbox, elsewhere: Elsewhere
) -> None:
    sandbox.faults.clear()
    sandbox.faults.add("/api.php", status=302, headers={"Location": elsewhere.url})
    with HttpSession(load_settings(dotenv=False)) as session:
        session.cookies.set("own", "cookie", domain="127.0.0.1")
        url = f"{sandbox.servers['wiki'].url}/api.php"
        send(session, "GET", url, headers={"Authorization": "Bearer ours"})
    ((path, headers),) = elsewhere.asked
    assert path == "/taken"
    assert not {"authorization", "cookie"} & {name.lower() for name in headers}
