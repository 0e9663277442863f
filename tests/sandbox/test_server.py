"""Tests of the servers of the sandbox."""

import pytest
import requests

from kb.sandbox.world import World
from tests.faults import Sandbox


def test_a_stopped_host_starts_again_on_its_port() -> None:
    with Sandbox(World(n_videos=0), services=["youtube"]) as services:
        host = services.servers["youtube"]
        address = f"{host.url}/watch?v=x"
        host.stop()
        with pytest.raises(requests.ConnectionError):
            requests.get(address, timeout=10)
        host.start()
        assert requests.get(address, timeout=10).status_code == 200
