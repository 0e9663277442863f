"""Tests of the servers of the sandbox."""

import pytest
import requests

from kb.sandbox.server import Sandbox
from tests.sandbox.test_faults import (
    services,  # noqa: F401  a fixture
    statuses,
)


def test_a_host_that_is_gone_comes_back_on_its_port(services: Sandbox) -> None:  # noqa: F811
    services.servers["youtube"].stop()
    with pytest.raises(requests.ConnectionError):
        statuses(services, 1)
    services.servers["youtube"].start()
    assert statuses(services, 1) == [200]
