"""Tests of `kb.youtube.ytdlp.info`."""

from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import spoken, vtt, write_video

VIDEOS = "SELECT * FROM clean.youtube_videos ORDER BY video_id"


def test_the_order_and_names_of_a_folder_do_not_matter(job: Job) -> None:
    folder = job.place / "videos"
    keys = [write_video(folder, number, ()) for number in range(4)]
    track = vtt(spoken("we build a farm", "in minecraft today"), automatic=True)
    (folder / f"{keys[0]}.en.vtt").write_text(track)
    (folder / f"Title 1 [{keys[1]}].en-orig.vtt").write_text(track)
    (folder / f"Title 2 [{keys[2]}].info.json").rename(folder / "Any name.info.json")
    (folder / "Any name.en-US.vtt").write_text(track)
    (folder / f"Title 3 [{keys[3]}].de.vtt").write_text(track)  # no English one
    assert job.done("youtube", "import", str(folder))["subtitles"] == 4
    filtered = job.done("youtube", "filter")
    assert {row["video_id"] for row in job.rows(VIDEOS)} == set(keys[:3])
    assert (filtered["kept"], filtered["pending"]) == (3, 1)
