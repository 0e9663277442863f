"""What goes wrong on purpose does so exactly as planned."""

import threading
from collections.abc import Iterator

import pytest
import requests

from kb.sandbox.world import World
from tests.faults import Sandbox


@pytest.fixture
def services() -> Iterator[Sandbox]:
    """YouTube alone, without videos."""
    with Sandbox(World(n_videos=0), services=["youtube"]) as sandbox:
        yield sandbox


def root(services: Sandbox) -> str:
    return services.servers["youtube"].url


def statuses(services: Sandbox, count: int, path: str = "/watch?v=x") -> list[int]:
    return [requests.get(root(services) + path, timeout=10).status_code for _ in range(count)]


def test_which_requests_a_fault_strikes(services: Sandbox) -> None:
    services.faults.add("/watch", status=503, after=1, times=2)
    assert statuses(services, 5) == [200, 503, 503, 200, 200]
    services.faults.add("v=other", status=500, times=None)
    assert statuses(services, 2) == [200, 200]


def test_connections_break_and_bodies_are_cut(services: Sandbox) -> None:
    services.faults.add("/watch", reset=True)
    with pytest.raises(requests.ConnectionError):
        statuses(services, 1)
    services.faults.add("/watch", cut=0.5)
    with pytest.raises(requests.exceptions.ChunkedEncodingError):
        statuses(services, 1)
    whole = requests.get(root(services) + "/watch?v=x", timeout=10).content
    services.faults.add("/watch", cut=0.5, honest=True)
    assert (
        requests.get(root(services) + "/watch?v=x", timeout=10).content == whole[: len(whole) // 2]
    )


def test_a_held_request_goes_on_when_released(services: Sandbox) -> None:
    held = services.faults.add("/watch", hold=True)
    got: list[int] = []
    thread = threading.Thread(target=lambda: got.extend(statuses(services, 1)))
    thread.start()
    assert held.arrived.wait(30)
    assert services.ledger.requests("/watch")[0].status is None
    held.release()
    thread.join(30)
    assert got == [200]


def test_the_ledger_has_every_request_and_no_key(services: Sandbox) -> None:
    requests.get(root(services) + "/youtube/v3/videos?part=id&id=a&key=hush", timeout=10)
    (seen,) = services.ledger.requests()
    assert (seen.service, seen.method, seen.path, seen.query, seen.status, seen.units) == (
        "youtube",
        "GET",
        "/youtube/v3/videos",
        "part=id&id=a",
        400,
        0,
    )
    assert "hush" not in str(seen)
