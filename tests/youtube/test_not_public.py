"""What a service or a file marks as not public is not collected."""

import json

import pytest

from kb.youtube.parse.playlists import playlists
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import info, video_id, write_video

REJECTED = "SELECT key, stage, reason, value FROM clean.youtube_rejected ORDER BY key"
WORDS = ("unlisted", "private", "needs_auth", "premium_only", "subscriber_only")


def test_files_of_videos_that_are_not_public_are_rejected_with_the_value(job: Job) -> None:
    folder = job.place / "videos"
    for number, word in enumerate(WORDS):
        write_video(folder, number, availability=word)
    for number, word in enumerate(("public", None, 7), start=len(WORDS)):
        write_video(folder, number, availability=word)
    job.done("youtube", "import", str(folder))
    assert job.done("youtube", "filter")["stages"] == {"not_public": len(WORDS)}
    assert job.rows(REJECTED) == [
        {"key": video_id(number), "stage": "not_public", "reason": word, "value": word}
        for number, word in enumerate(WORDS)
    ]
    job.done("youtube", "export")
    job.done("release")
    card = " ".join((job.root / "release/youtube/README.md").read_text().split())
    assert "Of 2 of 3 videos nothing says who may see them; they count as public." in card


def test_an_unlisted_video_that_is_asked_for_by_its_id_is_rejected(job: Job) -> None:
    """And its watch page is not read."""
    world = job.sandbox.world.youtube
    public = next(video.id for video in world.videos.values() if video.case.name == "manual")
    ids = job.place / "ids.txt"
    ids.write_text(f"{public}\n{world.unlisted.id}\n")
    job.done(*CRAWL, "--ids", str(ids))
    asked = {seen.args["v"] for seen in job.sandbox.ledger.requests("/watch")}
    assert asked == {public}
    assert job.done("youtube", "filter")["kept"] == 1
    key, word = world.unlisted.id, "unlisted"
    assert job.rows(REJECTED) == [
        {"key": key, "stage": "not_public", "reason": word, "value": word}
    ]


@pytest.mark.parametrize(
    ("word", "listed"), [("unlisted", []), ("public", ["PLone"]), (None, ["PLone"])]
)
def test_the_id_of_a_playlist_that_is_not_public_is_not_given_away(
    job: Job, word: str | None, listed: list[str]
) -> None:
    folder = job.place / "lists"
    folder.mkdir()
    about = {"_type": "playlist", "id": "PLone", "title": "x", "extractor_key": "YoutubeTab"}
    record = {**about, "availability": word, "entries": [info(video_id(5))]}
    (folder / "x.info.json").write_text(json.dumps(record))
    job.done("youtube", "import", str(folder))
    assert [key for key, one in playlists(job.root).items() if not one.left_out] == listed
