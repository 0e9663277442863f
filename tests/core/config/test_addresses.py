"""Addresses on this machine may be asked over plain http, others may not."""

import pytest

from kb.core.config.addresses import in_the_clear, is_loopback, root_of


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


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("127.0.0.1:8000", "like http://localhost"),
        ("http://", "like http://localhost"),
        ("http://a b", "like http://localhost"),
        (f"https://{'a' * 64}.example", "like http://localhost"),
        ("https://me:secret@wiki.example", "user name or password"),
        ("https://wiki.example?a", "without"),
        ("https://wiki.example:99999", "port"),
        ("http://wiki.example", "https://"),
    ],
)
def test_a_root_that_is_none_says_what_it_must_be(value: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        root_of(value, "http://localhost")


@pytest.mark.parametrize(
    "value", ["https://wiki.example/w/", "http://127.0.0.1:8000", "https://é.fr"]
)
def test_a_root_has_no_slash_at_its_end(value: str) -> None:
    assert root_of(value, "") == value.rstrip("/")
