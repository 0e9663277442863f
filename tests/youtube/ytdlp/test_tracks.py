"""Tests of `kb.youtube.ytdlp.tracks`."""

import pytest

from kb.youtube.ytdlp.tracks import ListedTracks, TrackKind, kind_of


@pytest.mark.parametrize(
    ("name", "timed", "manual", "automatic", "kind"),
    [
        ("en-orig", True, "", "en-orig en", ("asr", "en", "asr")),
        ("en", True, "", "en-orig en de", ("asr", "en", "asr")),
        ("en", False, "en", "", ("manual", "en", "manual")),
        ("en", False, "en", "en-orig en", ("manual", "en", "manual")),
        ("en", True, "en", "en-orig en", ("asr", "en", "asr")),
        ("en-GB", False, "en-GB", "en-orig en", ("manual", "en-GB", "manual")),
        ("en", False, "", "de-orig de en", ("translated", "de", "asr")),
        ("en", True, "", "de-orig de en", ("translated", "de", "asr")),
        ("en-de", False, "de", "en-de fr-de", ("translated", "de", "manual")),
        ("en", True, None, None, ("asr", "en", "asr")),
        ("en", False, None, None, ("manual", "en", "manual")),
        ("en-US", False, None, None, ("manual", "en-US", "manual")),
        ("en-de", False, None, None, ("translated", "de", "manual")),
    ],
)
def test_what_a_track_is(
    name: str, timed: bool, manual: str | None, automatic: str | None, kind: tuple[str, str, str]
) -> None:
    listed = None
    if manual is not None and automatic is not None:
        listed = ListedTracks(frozenset(manual.split()), frozenset(automatic.split()))
    assert kind_of(name, timed, listed) == TrackKind(*kind)
