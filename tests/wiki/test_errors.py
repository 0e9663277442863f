"""Tests of the errors of URLs and of the browser."""

import pytest

from kb.wiki import errors


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        *((status, errors.PageRefused) for status in (400, 401, 402, 403, 405, 406, 418, 429, 499)),
        *((status, errors.HttpStatus) for status in (404, 410, 414, 451)),
        (408, errors.TransientStatus),
        (425, errors.TransientStatus),
        (500, errors.HttpStatus),
    ],
)
def test_a_status_becomes_an_error(status: int, kind: type[Exception]) -> None:
    error = errors.of_status(status)
    assert type(error) is kind
    assert error.reason == f"http_{status}"


@pytest.mark.parametrize(
    ("reason", "kind"),
    [
        ("err_connection_refused", errors.NoResponse),
        ("err_timed_out", errors.NoResponse),
        ("err_blocked_by_client", errors.BrowserError),
    ],
)
def test_a_reason_of_chromium_becomes_an_error(reason: str, kind: type[Exception]) -> None:
    assert type(errors.of_browser(reason)) is kind
