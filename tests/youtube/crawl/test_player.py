"""Tests of `kb.youtube.crawl.player`."""

import json
import re
from pathlib import Path

import pytest

from kb.schema import raw
from kb.youtube.crawl.player import facts
from tests.youtube.parse.test_recorded import load


@pytest.mark.parametrize(
    "name",
    [
        "youtube.innertube.json",
        "youtube_age_restricted.innertube.json",
        "youtube_video_unavailable.innertube.json",
        "youtube_transcripts_disabled2.innertube.json",
    ],
)
def test_a_player_s_answer_leaves_no_address_and_nothing_undeclared(
    name: str, recorded: Path
) -> None:
    answer = load(recorded / "youtube" / "transcripts" / name)
    kept = facts(answer, "")
    private = r"https?:|//|visitor|2001:db8|INNERTUBE|signature|trackingParams|expire"
    assert not re.search(private, json.dumps(kept), re.IGNORECASE)
    assert not raw.unknown_keys("youtube/transcripts", {"player": kept})
    assert kept["playability"] == answer["playabilityStatus"]["status"]
    if name == "youtube.innertube.json":
        assert (kept["width"], kept["height"], kept["fps"]) == (3840, 2160, 24)
        assert [track["kind"] for track in kept["tracks"]].count("asr") == 1
        assert len(kept["tracks"]) == 9
