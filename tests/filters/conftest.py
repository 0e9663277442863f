"""Raw YouTube answers with a video for every reason."""

from pathlib import Path

import pytest

from tests.filters.made import MONDAY, listing, put, transcript, video


@pytest.fixture
def root(tmp_path: Path) -> Path:
    good = [
        "kept",
        "bare",
        "none",
        "disabled",
        "unread",
        "broken",
        "restricted",
        "roblox",
        "badcues",
    ]
    put(
        tmp_path,
        "videos",
        (MONDAY, {"id": ",".join([*good, "gone"])}, listing(*(video(key) for key in good))),
        (
            MONDAY,
            {},
            listing(
                video("unlisted", status__privacyStatus="unlisted", snippet__categoryId="22"),
                video("category", snippet__categoryId="22"),
                video("words", snippet__title="cooking", statistics__viewCount="5"),
                video("few", statistics__viewCount="99"),
                video("noviews", statistics__viewCount=KeyError),
                video("minus", statistics__viewCount="-5"),
                video("tall", player__embedWidth="270"),
                video("noshape", player=KeyError),
                video("live", contentDetails__duration="P0D"),
                video("odd", contentDetails__duration="5 minutes"),
                video("rated", contentDetails__contentRating={"ytRating": "ytAgeRestricted"}),
                video("hidden", statistics__likeCount=KeyError, statistics__viewCount="5"),
            ),
        ),
    )
    put(
        tmp_path,
        "transcripts",
        transcript("kept"),
        transcript("bare", player=None),
        transcript("none", "none"),
        transcript("disabled", "disabled"),
        transcript("broken", "failed", player=None),
        transcript("restricted", "age_restricted", player=None),
        transcript("roblox", player={"game_label_id": "UCx", "game_label": "Roblox"}),
        transcript("badcues", cues={"start_s": [0], "text": ["x"]}, player=None),
    )
    return tmp_path
