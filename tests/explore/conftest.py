"""`kb explore` in a process of its own, and a browser."""

import http.client
import os
import re
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

import pytest

from tests import processes
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
from tests.report.test_browser import browser  # noqa: F401  the fixture


class Answer(NamedTuple):
    """Status, headers in lower case, and text."""

    status: int
    headers: dict[str, str]
    text: str


class Explored:
    """A running server."""

    def __init__(self, process: processes.ForkedProcess) -> None:
        self.process = process
        self.address = address = next(iter(process.lines(1)), "")
        self.port = int(address.rstrip("/").rpartition(":")[2] or 0)  # "" where it did not start

    def ask(
        self, path: str, method: str = "GET", body: str | None = None, **headers: str
    ) -> Answer:
        """One request."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        named = {name.lower(): value for name, value in answer.getheaders()}
        return Answer(answer.status, named, text)

    def post(self, path: str, fields: Mapping[str, str], **headers: str) -> Answer:
        """A form, as this page's own unless `headers` say otherwise."""
        sent = {"Origin": self.address.rstrip("/")} | headers
        sent["Content-Type"] = "application/x-www-form-urlencoded"
        return self.ask(path, "POST", body=urlencode(fields), **sent)

    def image(self, path: str) -> tuple[int, bytes]:
        """The status, and the first eight bytes of what comes."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request("GET", path)
        answer = connection.getresponse()
        start = answer.read()[:8]
        connection.close()
        return answer.status, start


# So that root, as which tests may run, obeys the permissions of files as well.
UNPRIVILEGED = ("setpriv", "--bounding-set", "-dac_override") if os.geteuid() == 0 else ()
_BECOME = "import os, sys; os.execvp(sys.argv[1], sys.argv[1:])"


@contextmanager
def explored(root: Path, *options: str, before: Sequence[str] = ()) -> Iterator[Explored]:
    """`kb explore` over a folder, until the block ends; `before` are words before the command."""
    words = ("explore", "--no-browser", "--data", root, *options)
    at: Any = {"env": {**clean_environment(), "PYTHONPATH": str(ROOT)}, "cwd": Path(os.sep)}
    if before:
        whole = (*before, sys.executable, "-m", "kb", *words)
        process = processes.program(_BECOME, *whole, **at)
    else:
        process = processes.start(words, **at)
    try:
        yield Explored(process)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


@pytest.fixture(scope="session")
def demo_pages(demo: Path) -> Iterator[Explored]:
    """The pages over the demo's root."""
    with explored(demo / "data" / "demo") as one:
        yield one


@pytest.fixture(scope="session")
def release_pages(demo: Path) -> Iterator[Explored]:
    """The pages over the demo's release, as somebody downloaded it."""
    with explored(demo / "data" / "demo" / "release") as one:
        yield one


def total(text: str) -> int:
    found = re.search(r"<p>([\d,]+) rows", text)
    assert found
    return int(found[1].replace(",", ""))


def figures(text: str) -> tuple[int, int, int]:
    """Kept with the threshold, kept now, and rows that wait for something."""
    words = re.sub(r"<.*?>", "", text.partition('id="figures"')[2].partition("</p>")[0])
    then, now = re.findall(r"([\d,]+) kept instead of ([\d,]+)", words)[0]
    waiting = re.findall(r"; ([\d,]+) (?:wait|count)", words)
    return number(then), number(now), sum(map(number, waiting))


def number(text: str) -> int:
    return int(text.replace(",", ""))
