"""Addresses on this machine may be asked over plain http, others may not."""

import pytest

from kb.core.config.addresses import in_the_clear, is_loopback


@pytest.mark.parametrize(
    ("url", "loopback", "clear"),
    [
        ("http://localhost:8000", True, False),
        ("http://127.0.0.2", True, False),
        ("http://[::1]:80", True, False),
        ("http://localhost.example.org", False, True),
        ("http://192.168.0.1", False, True),
        ("https://example.org", False, False),
    ],
)
def test_only_this_machine_may_be_asked_in_the_clear(url: str, loopback: bool, clear: bool) -> None:
    assert (is_loopback(url), in_the_clear(url)) == (loopback, clear)
