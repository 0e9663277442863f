"""Tests of `kb.youtube.ytdlp.info`."""

import json

from kb.youtube.ytdlp.info import playlists
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import FORMS, info, video_id, write_video


def test_raw_keeps_subtitles_verbatim_and_no_address_of_an_info_json(job: Job) -> None:
    folder = job.place / "videos"
    key = write_video(folder, 1, tuple(FORMS))
    job.done("youtube", "import", str(folder))
    for answer in job.raw("ytdlp_subtitles"):
        name = f"Title 1 [{key}].en.{answer['response']['format']}"
        assert answer["response"]["text"] == (folder / name).read_text()
        assert answer["request"]["params"]["file"] == name
    (one,) = job.raw("ytdlp_info")
    text = json.dumps(one)
    for secret in ("SECRET", "203.0.113.7", "signed.example", "VISITOR", str(job.place)):
        assert secret not in text
    kept = one["response"]
    assert kept["automatic_tracks"] == ["en-orig", "en", "de"]
    assert kept["chapters"] == [{"start_time": 0.0, "title": "Intro", "end_time": 20.0}]


def test_the_first_playlist_by_id_counts_and_uploads_are_none(job: Job) -> None:
    folder = job.place / "lists"
    folder.mkdir()
    for key, numbers in (("UCuploads", (5, 6, 7)), ("PLsecond", (5, 6)), ("PLfirst", (6,))):
        entries = [info(video_id(number)) for number in numbers]
        about = {"_type": "playlist", "id": key, "title": key, "extractor_key": "YoutubeTab"}
        (folder / f"{key}.info.json").write_text(json.dumps({**about, "entries": entries}))
    job.done("youtube", "import", str(folder))
    assert playlists(job.root) == {video_id(5): "PLsecond", video_id(6): "PLfirst"}
