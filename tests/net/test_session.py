"""Plain HTTP against a real server on loopback."""

import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from kb.core.config.settings import load_settings
from kb.core.errors import Retryable
from kb.net.session import HttpSession, send, user_agent


class Service(BaseHTTPRequestHandler):
    """/STATUS answers with that status; /cut promises more than it sends."""

    def do_GET(self) -> None:
        if self.path.startswith("/cut"):
            self.send_response(200)
            self.send_header("Content-Length", "1000")
            self.end_headers()
            self.wfile.write(b"short")
            return
        status = int(self.path.strip("/").split("?")[0])
        body = (
            self.headers["Authorization"] or "none"
            if "authorization" in self.path
            else self.headers["User-Agent"]
        ).encode()
        self.send_response(status)
        if status == 302:
            self.send_header("Location", "/200?authorization")
        if status in (429, 503):
            self.send_header("Retry-After", "17")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        """Quiet."""


@pytest.fixture(scope="module")
def root() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Service)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_says_who_asks(root: str) -> None:
    with HttpSession(load_settings(dotenv=False, kb_contact="me@example.org")) as session:
        assert send(session, "GET", f"{root}/200").text == user_agent("me@example.org")
    assert user_agent("me@example.org").endswith(" (+me@example.org)")
    assert "(" not in user_agent(None)


def test_netrc_takes_no_credentials_place(
    root: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "netrc").write_text("machine 127.0.0.1 login someone password else\n")
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    with HttpSession(load_settings(dotenv=False)) as session:
        ours = {"Authorization": "Bearer ours"}
        assert session.get(f"{root}/200?authorization", headers=ours).text == "Bearer ours"
        assert session.get(f"{root}/302", headers=ours).text == "Bearer ours"
        assert session.get(f"{root}/200?authorization").text == "none"
        assert session.get(f"{root}/200?authorization", auth=("a", "b")).text.startswith("Basic ")


@pytest.mark.parametrize("status", [200, 204, 403, 404])
def test_other_answers_are_the_callers(root: str, status: int) -> None:
    with HttpSession(load_settings(dotenv=False)) as session:
        assert send(session, "GET", f"{root}/{status}").status_code == status


@pytest.mark.parametrize(("status", "after"), [(429, 17.0), (500, None), (503, 17.0)])
def test_what_may_go_well_later(root: str, status: int, after: float | None) -> None:
    with HttpSession(load_settings(dotenv=False)) as session, pytest.raises(Retryable) as caught:
        send(session, "GET", f"{root}/{status}?key=s3cret")
    assert caught.value.after == after
    assert not caught.value.unreachable
    assert "s3cret" not in str(caught.value)


def test_a_broken_answer_and_no_server_are_unreachable(root: str) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        nowhere = f"http://127.0.0.1:{unused.getsockname()[1]}/x?key=s3cret"
        for url in (f"{root}/cut", nowhere):
            with (
                HttpSession(load_settings(dotenv=False)) as session,
                pytest.raises(Retryable) as caught,
            ):
                send(session, "GET", url)
            assert caught.value.unreachable
            assert "s3cret" not in str(caught.value)
