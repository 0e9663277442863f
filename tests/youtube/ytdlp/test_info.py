"""Tests of `kb.youtube.ytdlp.info`."""

import json

from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import FORMS, write_video


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
