"""Secrets pass no line."""

import json
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.net import redact

KEY = "AIzaSyA" + "x1_-" * 8


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    yield
    redact.know([])


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (f"a token hf_{'Ab' * 17} in a line", f"a token {redact.MARK} in a line"),
        (
            f"HttpError 400 when requesting https://x/youtube/v3/search?part=id&key={KEY}&alt=json",
            "&key=***&alt=json",
        ),
        (f"found {KEY} in a page", "found *** in a page"),
        ("{'Authorization': 'Bearer eyJhbGciOiJSUzI1NiIsImtpZCI6'}", "Bearer ***"),
        ("Authorization: Basic dXNlcjpwYXNz", "Basic ***"),
        (
            "POST grant_type=refresh_token&refresh_token=abc-123&client_secret=s3",
            "refresh_token=***&client_secret=***",
        ),
        (
            (
                '"GET /api/timedtext?v=a&ip=10.9.8.7&ei=abc&sparams=ip,ei&signature=0A.1B'
                '&key=yt8 HTTP/1.1"'
            ),
            "&ip=***&ei=***&sparams=ip,ei&signature=***&key=***",
        ),
        (
            r'{"baseUrl":"/api/timedtext?v=a\u0026lsig=0A1B\u0026lang=en"}',
            r"\u0026lsig=***\u0026lang=en",
        ),
        ("proxy http://user:hunter2@10.0.0.1:3128/ refused", "http://***@10.0.0.1:3128/"),
    ],
)
def test_what_looks_like_a_secret_is_replaced(line: str, wanted: str) -> None:
    assert wanted in redact.text(line)


@pytest.mark.parametrize(
    "line",
    [
        "kb: unknown key 'min_vews', did you mean 'min_views'?",
        "videos.list: 50 ids, 1 unit",
        "https://www.youtube.com/watch?v=dQw4w9WgXcQ",
        "tip=3 and zip=4 are no addresses, nor is signature=mine",
        "metadata: 40/40 videos, 12.0/s, units 4/10000",
    ],
)
def test_ordinary_lines_stay(line: str) -> None:
    assert redact.text(line) == line


def test_literal_secrets_also_inside_urls() -> None:
    redact.know(["pa ss/word+1", ""])
    assert redact.text("x pa ss/word+1 y") == "x *** y"
    assert redact.text("?s=pa%20ss%2Fword%2B1 ?s=pa+ss%2Fword%2B1") == "?s=*** ?s=***"


def test_json_text_is_searched_for_long_literals_alone() -> None:
    redact.know(["items", 'quo"ted\\pass', KEY])
    assert redact.holds_secret(json.dumps({"a": f"see {KEY}"}).encode())
    assert redact.holds_secret(json.dumps({"a": 'quo"ted\\pass'}).encode())
    assert not redact.holds_secret(b'{"items": []}')
    assert redact.literal(f"items?key={KEY}&token=other") == "items?key=***&token=other"


def test_a_secret_that_begins_with_another_goes_whole() -> None:
    redact.know(["abcdefgh", "abcdefghij"])
    assert redact.text("abcdefghij abcdefgh") == "*** ***"


def test_a_short_secret_does_not_blank_the_log() -> None:
    redact.know(["a", "key", "hunter2"])
    assert redact.text("a keyword and hunter2") == "a keyword and hunter2"
    assert redact.text("?key=hunter2&a=b") == "?key=***&a=b"  # where it is recognised by its place


@given(st.text(), st.text(), st.text(alphabet=st.characters(codec="utf-8"), min_size=8))
def test_no_line_holds_a_known_secret(before: str, after: str, secret: str) -> None:
    redact.know([secret])
    shown = redact.text(before + secret + after)
    assert (
        secret not in shown
        or secret in redact.MARK * 4
        or secret in redact.text(before) + redact.MARK + redact.text(after)
    )
