"""Which playlist an imported video was found in."""

import json

from kb.youtube.ytdlp.playlists import playlists
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import info, video_id


def test_the_first_playlist_by_id_counts_and_uploads_are_none(job: Job) -> None:
    folder = job.place / "lists"
    folder.mkdir()
    for key, numbers in (("UCuploads", (5, 6, 7)), ("PLsecond", (5, 6)), ("PLfirst", (6,))):
        entries = [info(video_id(number)) for number in numbers]
        about = {"_type": "playlist", "id": key, "title": key, "extractor_key": "YoutubeTab"}
        (folder / f"{key}.info.json").write_text(json.dumps({**about, "entries": entries}))
    job.done("youtube", "import", str(folder))
    assert playlists(job.root) == {video_id(5): "PLsecond", video_id(6): "PLfirst"}
