"""Services that decide how much we read, and for how long: each answer is one error by the usual
rules, in bounded memory and time. Nothing on this machine is asked through a proxy.
"""

import gzip
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from kb.core import signals
from kb.core.config.settings import load_settings
from kb.core.errors import Interrupted, Retryable
from kb.net import bounded, limits
from kb.net.session import HttpSession, send

OK = b"HTTP/1.1 200 OK\r\n"
END = b"Connection: close\r\n\r\n"


def bomb(send: Callable[[bytes], None]) -> None:
    packed = gzip.compress(bytes(20_000_000))
    send(OK + b"Content-Encoding: gzip\r\n" + END + packed)


def endless(send: Callable[[bytes], None]) -> None:
    send(OK + END)
    while True:
        send(bytes(1 << 16))


def redirect(send: Callable[[bytes], None]) -> None:
    send(b"HTTP/1.1 302 Found\r\nLocation: /elsewhere\r\n" + END)
    while True:
        send(bytes(1 << 16))


def drips(send: Callable[[bytes], None]) -> None:
    send(OK + END)
    while True:
        send(b"x")
        time.sleep(0.05)


def drips_header(send: Callable[[bytes], None]) -> None:
    send(OK + b"X-Slow: ")
    while True:
        send(b"x")
        time.sleep(0.05)


def silent(send: Callable[[bytes], None]) -> None:
    send(OK + b"Content-Length: 100\r\n\r\n")
    time.sleep(60)


SERVICES = {each.__name__: each for each in (bomb, endless, redirect, drips, drips_header, silent)}


class Hostile:
    """Answers every connection in one of these ways, named by the path."""

    def __init__(self) -> None:
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listening.getsockname()[1]}"
        self.asked: list[str] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self.listening.accept()
            except OSError:
                return
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with connection:
            first = connection.recv(1 << 16).split(b" ")[1].decode()
            self.asked.append(first)
            name = first.rpartition("/")[2]
            try:
                if name in SERVICES:
                    SERVICES[name](connection.sendall)
                else:
                    connection.sendall(OK + END + b"fine")
            except OSError:
                return  # given up by the client


@pytest.fixture(scope="module")
def hostile() -> Iterator[Hostile]:
    service = Hostile()
    yield service
    service.listening.close()


@pytest.mark.parametrize("name", SERVICES)
def test_an_answer_without_end_is_one_error(
    hostile: Hostile, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "ANSWER_BYTES", 1_000_000)
    monkeypatch.setattr(limits, "ANSWER_S", 1.0)
    with HttpSession(load_settings(dotenv=False)) as session:
        with pytest.raises(Retryable, match=r"^(TooLarge|TooSlow|ReadTimeout) at "):
            send(session, "GET", f"{hostile.url}/{name}")
        assert send(session, "GET", f"{hostile.url}/fine").text == "fine"


@pytest.mark.parametrize("name", ["drips", "drips_header", "silent"])
def test_a_signal_ends_a_read_that_waits(
    hostile: Hostile, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounded, "_STOP_S", 0.1)
    asked = len(hostile.asked)

    def stop() -> None:
        while len(hostile.asked) == asked:
            time.sleep(0.01)
        signals.stop.request("SIGTERM")

    thread = threading.Thread(target=stop)
    thread.start()
    try:
        with HttpSession(load_settings(dotenv=False)) as session, pytest.raises(Interrupted):
            send(session, "GET", f"{hostile.url}/{name}")
    finally:
        thread.join()
        signals.stop.clear()


def test_an_answer_that_was_in_hand_when_the_signal_came_is_read(hostile: Hostile) -> None:
    signals.stop.request("SIGTERM")
    try:
        with HttpSession(load_settings(dotenv=False)) as session:
            assert send(session, "GET", f"{hostile.url}/fine").text == "fine"
    finally:
        signals.stop.clear()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "127.0.0.2"])
@pytest.mark.parametrize("name", ["http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"])
def test_this_machine_is_never_asked_through_a_proxy(
    hostile: Hostile, host: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for each in [one for one in os.environ if one.lower().endswith("_proxy")]:
        monkeypatch.delenv(each)
    proxy = Hostile()
    monkeypatch.setenv(name, proxy.url.replace("://", "://user:secret@"))
    port = hostile.listening.getsockname()[1]
    if host == "127.0.0.2":  # every address of 127.0.0.0/8 is this machine's
        other = socket.create_server((host, 0))
        port = other.getsockname()[1]
        hostile_there = Hostile.__new__(Hostile)
        hostile_there.listening, hostile_there.asked = other, []
        threading.Thread(target=hostile_there._serve, daemon=True).start()
    with HttpSession(load_settings(dotenv=False)) as session:
        assert send(session, "GET", f"http://{host}:{port}/fine?key=mine").text == "fine"
    assert proxy.asked == []
    proxy.listening.close()
