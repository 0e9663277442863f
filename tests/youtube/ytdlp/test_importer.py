"""Folders of yt-dlp are imported."""

import json
import os
import shutil
from typing import Any

import pytest

from kb.store.rawlog import rawlog
from kb.youtube.ytdlp.tracks import ListedTracks, TrackKind, TrackLanguage, kind_of, language_of
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import FORMS, info, spoken, video_id, vtt, write_video

VIDEOS = "SELECT * FROM clean.youtube_videos ORDER BY video_id"
TRACKS = "SELECT * FROM clean.youtube_transcripts ORDER BY video_id"


def test_a_root_of_files_alone_goes_through_every_stage(job: Job) -> None:
    folder = job.place / "videos"
    for number, form in enumerate(FORMS):
        write_video(folder / form, number, (form,))
    before = len(job.sandbox.ledger)
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["subtitles"], summary["left_out_by"]) == (3, 3, {})
    assert {"license", "made_for_kids", "definition"} <= set(summary["null_columns"])
    assert "view_count" not in summary["null_columns"]
    filtered = job.done("youtube", "filter")
    assert (filtered["kept"], filtered["unknown_keys"]) == (3, {})
    rows, tracks = job.rows(VIDEOS), job.rows(TRACKS)
    for row in rows:
        assert (row["width"], row["height"], row["fps"]) == (1920, 1080, 60)
        assert (row["category_id"], row["topic_evidence"]) == (20, "keywords")
        assert (row["transcript_kind"], row["word_count"]) == ("asr", 16)
        assert (row["view_count"], row["license"]) == (54_321, None)
        assert (row["view_rule"], row["metadata_origin"]) == ("playback_start", "file")
        assert f"{row['fetched_at']:%Y-%m-%d}" == "2026-09-21"
    assert tracks[0]["cues"] == tracks[1]["cues"] == tracks[2]["cues"]
    assert [cue["text"] for cue in tracks[0]["cues"]][:2] == [
        "so today we build a farm",
        "with a water bucket and",
    ]
    job.done("youtube", "export")
    likely = job.done("pairs")
    assert likely["pairs"] > 0
    assert job.done("release")["folders"] == 2  # read 60 days ago, unscored, by nobody named
    card = (job.root / "release/youtube/README.md").read_text()
    assert "Toxicity: not scored" in card.partition("|  |  |")[0]
    assert "described all 3 videos; their dates are 2026-09-21." in " ".join(card.split())
    assert not any(
        word in card for word in ("keyword search", "watch pages", "terms ask", "| Built")
    )
    job.profile(("[youtube]\n", '[youtube]\nimported_topic = "known"\n'))
    job.done("youtube", "filter")
    assert {row["topic_evidence"] for row in job.rows(VIDEOS)} == {"profile"}
    # "so today we build a farm": a word of the topic needs no other.
    known = job.done("pairs")
    assert known["matches"] == likely["matches"]
    assert known["ambiguous"] < likely["ambiguous"]
    assert len(job.sandbox.ledger) == before  # nothing was sent


def test_what_cannot_be_used_is_counted_by_reason_and_never_fatal(job: Job) -> None:
    folder = job.place / "videos"
    key = write_video(folder, 1)
    text = json.dumps(info(video_id(2)))
    for name, content in {
        "a.info.json": text[: len(text) // 2],
        "b.info.json": "",
        "c.info.json": "[]",
        "d.info.json": json.dumps(info(video_id(3), extractor_key="Vimeo", extractor="vimeo")),
        "e [test0000041].mp4.part": "x",
        "e [test0000041].f137.mp4.ytdl": "x",
        "e [test0000041].temp.mp4": "x",
        f"{key}.en-GB.vtt": "WEBVTT\n\nnot a cue",
        f"{key}.en-GB.srv3": "<timedtext><body><p>",
        f"{key}.en-GB.json3": b"\xff\xfe\x00",
        f"{key}.live_chat.json": "{}",
        f"{key}.en.srt": "1",
        f"{key}.en.ass": "1",
        "nameless.en.vtt": vtt(spoken("a b"), automatic=True),
        "notes.txt": "x",
    }.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "gone.info.json").symlink_to(folder / "nowhere")
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["subtitles"]) == (1, 1)
    assert summary["left_out_by"] == {
        "broken_info": 3,
        "unreadable": 1,
        "other_sites": 1,
        "unfinished_downloads": 3,
        "broken_subtitles": 4,
        "other_subtitles": 1,
        "without_video_id": 1,
        "other_files": 2,
    }
    lines = job.kb("youtube", "import", str(folder), "--data", str(job.place / "b")).stdout
    (line,) = [one for one in lines.splitlines() if one.startswith("files left out:")]
    assert "broken info 3" in line
    assert "made_for_kids (all)" in lines


def test_a_name_with_a_line_break_is_read_and_shown_in_one_line(job: Job) -> None:
    folder, key = job.place / "videos", video_id(1)
    folder.mkdir()
    for name, content in {
        f"two\nlines [{key}].info.json": json.dumps(info(key)),
        f"two\nlines [{key}].en.vtt": vtt(spoken("a b"), automatic=True),
        f"two\nlines [{key}].mkv": "x",
        f"two\nlines [{key}].ass": "1",
        f"two\nlines [{key}].vtt": "1",
        f"two\nlines [{key}].mp4.part": "x",
        "mp4.part\n": "x",
        f"two\nlines-{video_id(2)}.en.vtt": vtt(spoken("c d"), automatic=True),
    }.items():
        (folder / name).write_text(content)
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["subtitles"]) == (1, 2)
    assert summary["left_out_by"] == {
        "other_files": 1,
        "other_subtitles": 1,
        "unfinished_downloads": 1,
        "without_language": 1,
    }
    lines = job.kb("youtube", "import", str(folder), "--data", str(job.place / "b")).stdout
    assert f"  other subtitles: two\\nlines [{key}].ass" in lines.splitlines()


@pytest.mark.parametrize("changes", [{"id": "wrongid"}, {"id": None}, {"title": ...}])
def test_a_damaged_file_of_youtube_is_not_of_another_site(
    job: Job, changes: dict[str, Any]
) -> None:
    folder = job.place / "videos"
    write_video(folder, 1)
    record = {**info(video_id(2), extractor="youtube", extractor_key="Youtube"), **changes}
    record = {name: value for name, value in record.items() if value is not ...}
    (folder / "two.info.json").write_text(json.dumps(record))
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["left_out_by"]) == (1, {"broken_info": 1})


def test_linked_folders_are_entered_and_links_that_lead_back_are_left_out(job: Job) -> None:
    folder, disk, back = job.place / "videos", job.place / "disk", job.place / "videos/back"
    write_video(folder, 1)
    write_video(disk / "more", 2)
    write_video(disk / "lost+found", 3)
    (folder / "linked").symlink_to(disk)
    (disk / "more/up").symlink_to(folder)
    back.symlink_to(back)
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["left_out_by"]) == (2, {"other_files": 2})
    assert summary["left_out_files"] == {"other_files": ["back", "up"]}


def test_a_video_of_several_files_is_one_imported_video(job: Job) -> None:
    folder = job.place / "videos"
    for number in (1, 2):
        write_video(folder / "first", number)
    (folder / "again.info.json").write_text(json.dumps(info(video_id(1), epoch=1_800_000_000)))
    summary = job.done("youtube", "import", str(folder))
    assert (summary["crawled"], summary["files"]) == (2, 5)
    assert job.done("youtube", "filter")["crawled"] == 2


def test_nothing_to_import_is_exit_1_with_the_reason_and_no_folder_is_exit_2(job: Job) -> None:
    folder = job.place / "videos"
    folder.mkdir()
    (folder / "a.info.json").write_text("{")
    assert "broken info (1 files)" in job.stopped("youtube", "import", str(folder), code=1)
    nowhere = str(job.place / "nowhere")
    other = job.place / "other"
    assert nowhere in job.stopped("youtube", "import", nowhere, "--data", str(other), code=2)
    assert not other.exists()


def test_an_import_is_resumed_after_a_kill_and_repeats_nothing(job: Job) -> None:
    folder = job.place / "videos"
    for number in range(40):
        write_video(folder / str(number % 3), number)
    assert job.done("youtube", "import", str(folder), "--limit", "10", code=3)["files"] == 10
    process = job.start("youtube", "import", str(folder))
    process.kill()
    process.wait()
    job.done("youtube", "import", str(folder))
    again = job.done("youtube", "import", str(folder))
    assert (again["files"], again["known_files"]) == (0, 80)
    kinds = ("ytdlp_info", "ytdlp_subtitles")
    files = [one["request"]["params"]["file"] for kind in kinds for one in job.raw(kind)]
    assert len(files) == len(set(files)) == 80
    assert job.done("youtube", "filter")["kept"] == 40


@pytest.mark.parametrize("with_entries", [True, False])
def test_playlists_give_their_videos(job: Job, with_entries: bool) -> None:
    folder = job.place / "channel"
    folder.mkdir()
    flat = {"_type": "url", "ie_key": "Youtube", "id": video_id(7), "title": "flat", "url": "x"}
    inner = {
        "_type": "playlist",
        "id": "UCchannel",
        "title": "Videos",
        "extractor_key": "YoutubeTab",
        "entries": [info(video_id(5)), info(video_id(6)), flat, None, {"id": None}],
    }
    playlist: dict[str, Any] = {**inner, "title": "A channel", "entries": [inner]}
    if not with_entries:  # what yt-dlp writes without --no-clean-info-json
        del playlist["entries"]
    (folder / "A channel [UCchannel].info.json").write_text(json.dumps(playlist))
    summary = job.done("youtube", "import", str(folder))
    # Both lists have the id of the channel, and are counted once.
    assert (summary["crawled"], summary["playlists"]) == ((2, 1) if with_entries else (0, 1))
    assert job.done("youtube", "import", str(folder))["known_files"] == 1
    if with_entries:
        assert job.done("youtube", "filter")["crawled"] == 2
        assert job.done("status")["sources"]["youtube"]["left_by"] == {"videos": 1}


def test_files_beside_a_crawl_replace_nothing_by_null(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    before = {row["video_id"]: row for row in job.rows(VIDEOS)}
    tracks = {row["video_id"]: row for row in job.rows(TRACKS)}
    newer, older = sorted(before)[:2]
    folder = job.place / "videos"
    folder.mkdir()
    late = {"epoch": 1_800_000_000, "like_count": None, "description": None, "view_count": 999_999}
    for key, changes in ((newer, late), (older, {"epoch": 1_700_000_000, "title": "old"})):
        (folder / f"{key}.info.json").write_text(json.dumps(info(key, **changes)))
    assert job.done("youtube", "import", str(folder))["crawled"] == 2
    job.done("youtube", "filter")
    rows = {row["video_id"]: row for row in job.rows(VIDEOS)}
    assert rows[older] == before[older]
    row = rows[newer]
    assert (row["view_count"], row["like_count"]) == (999_999, None)
    assert f"{row['fetched_at']:%Y}" == "2027"
    for name in ("license", "made_for_kids", "definition", "topic_evidence", "word_count"):
        assert row[name] == before[newer][name], name
    assert row["description"] == before[newer]["description"]
    assert {row["video_id"]: row for row in job.rows(TRACKS)} == tracks


def test_a_file_does_not_bring_back_what_the_service_has_removed(job: Job) -> None:
    job.done(*CRAWL)
    world = job.sandbox.world.youtube.videos
    gone = next(key for key, video in world.items() if not video.in_api)
    folder = job.place / "videos"
    folder.mkdir()
    (folder / f"{gone}.info.json").write_text(json.dumps(info(gone, epoch=1_900_000_000)))
    job.done("youtube", "import", str(folder))
    job.done("youtube", "filter")
    sql = f"SELECT stage FROM clean.youtube_rejected WHERE key = '{gone}'"
    assert job.rows(sql) == [{"stage": "missing"}]
    job.done("purge", "youtube")
    assert job.raw("ytdlp_info") == []
    shutil.rmtree(job.root / "state")
    assert job.done("youtube", "import", str(folder), code=1)["left_out_by"] == {"purged": 1}


def test_a_crawl_asks_for_what_files_lack_and_for_nothing_else(job: Job) -> None:
    videos = job.sandbox.world.youtube.videos
    ours = sorted(
        key
        for key, one in videos.items()
        if one.in_api and any(t.kind == "asr" for t in one.tracks)
    )[:2]
    folder = job.place / "videos"
    folder.mkdir()
    for key in ours:
        (folder / f"{key}.info.json").write_text(json.dumps(info(key)))
    text = vtt(spoken("we build a farm", "in minecraft today"), automatic=True)
    (folder / f"{ours[0]}.en.vtt").write_text(text)
    job.done("youtube", "import", str(folder))
    before = len(job.sandbox.ledger)
    job.done(*CRAWL, "--only", "transcripts")
    asked = {seen.args["v"] for seen in job.sandbox.ledger.requests("/watch", since=before)}
    assert asked == {ours[1]}


def test_a_video_without_any_english_track_is_rejected_as_one(job: Job) -> None:
    folder = job.place / "videos"
    write_video(folder, 1, (), automatic_captions={}, subtitles={"de": [], "live_chat": []})
    write_video(folder, 2, (), automatic_captions={}, subtitles={"en": []})
    job.done("youtube", "import", str(folder))
    job.done("youtube", "filter")
    rejected = job.rows("SELECT key, stage, reason FROM clean.youtube_rejected")
    assert rejected == [{"key": video_id(1), "stage": "transcript", "reason": "none"}]
    assert [row["key"] for row in job.rows("SELECT key FROM clean.youtube_pending")] == [
        video_id(2)
    ]


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


def test_files_of_other_versions_of_the_program_are_read(job: Job) -> None:
    """Names of youtube-dl and of people, tracks with names, channels as uploaders."""
    folder, channel = job.place / "videos", "UC" + "x" * 22
    folder.mkdir()
    track = vtt(spoken("we build a farm", "in minecraft today"), automatic=False)
    about: dict[str, dict[str, Any]] = {
        "My best title-{}": {"channel": None, "channel_id": None, "uploader": "Ann"},
        "Title [youtube-{}]": {"uploader_id": channel, "uploader": "Ben"},
        "{}": {"uploader_id": "@ben", "uploader": None},
    }
    languages = ("EN", "en-Qx_9zR4b-1k", "en-abcdefghi-k")
    storyboard = {"ext": "mhtml", "vcodec": "none", "width": 3200, "height": 1800, "fps": 0.5}
    sheet = {"protocol": "mhtml", "width": 1600, "height": 1600}
    formats = [storyboard, {"width": 720, "height": 1280, "fps": 25}, sheet]
    for number, (name, changes) in enumerate(about.items()):
        key, language = video_id(number), languages[number]
        record = info(
            key, formats=formats, automatic_captions={}, subtitles={language: []}, **changes
        )
        for left in {"channel", "channel_id"} - changes.keys():
            del record[left]
        (folder / f"{number}.info.json").write_text(json.dumps(record))
        suffix = "VTT" if language == "EN" else "vtt"
        (folder / f"{name.format(key)}.{language}.{suffix}").write_text(track)
    job.profile(("min_aspect_ratio = 1.0", "min_aspect_ratio = 0.1"))
    assert job.done("youtube", "import", str(folder))["subtitles"] == 3
    job.done("youtube", "filter")
    rows = job.rows(VIDEOS)
    assert [(row["channel_title"], row["channel_id"]) for row in rows] == [
        ("Ann", None),
        ("Ben", channel),
        (None, None),
    ]
    assert {(row["width"], row["height"], row["transcript_kind"]) for row in rows} == {
        (720, 1280, "manual")
    }
    assert [row["language"] for row in job.rows(TRACKS)] == ["en"] * 3


def test_an_odd_value_in_a_file_costs_that_value(job: Job) -> None:
    """And a file that can't be read at all is named with the reason."""
    folder = job.place / "videos"
    folder.mkdir()
    odd = {
        "utf-8-sig": ('"like_count": 1234', '"like_count": 1e999'),
        "utf-16": ('"average_rating": null', '"average_rating": NaN'),
        "utf-8": ('"title": "', '"title": "\\ud83c '),
        "utf-16-le": ('"duration": 321', '"duration": 321.7'),
    }
    for number, (encoding, change) in enumerate(odd.items()):
        text = json.dumps(info(video_id(number)))
        assert change[0] in text
        path = folder / f"{video_id(number)}.info.json"
        path.write_bytes(text.replace(*change).encode(encoding))
    (folder / f"{video_id(0)}.en.srv3").write_bytes("<timedtext><bo".encode("utf-16"))
    summary = job.done("youtube", "import", str(folder))
    assert summary["crawled"] == 4
    assert summary["left_out_files"]["broken_subtitles"][0].startswith(
        f"{video_id(0)}.en.srv3 (not XML"
    )
    job.kb("youtube", "filter")
    pending = {row["key"] for row in job.rows("SELECT key FROM clean.youtube_pending")}
    assert pending == {video_id(number) for number in range(4)}  # without their transcripts


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


@pytest.mark.parametrize(
    ("name", "language"),
    [
        *(
            (name, name)
            for name in ("en", "en-GB", "zh-Hans", "es-419", "ca-valencia", "sr-Latn-RS")
        ),
        *((f"en-{name}", "en") for name in ("Qx_9zR4b-1k", "AbCdEfGhIjK", "a-b-c-d-e-f")),
        ("pt-BR-eEY6OEpapPo", "pt-BR"),
        *(("iw", "he"), ("iw-IL", "he-IL"), ("in", "id"), ("ji", "yi"), ("no", "nb"), ("nn", "nn")),
    ],
)
def test_the_language_of_a_track(name: str, language: str) -> None:
    assert language_of(name) == language
    assert TrackLanguage(language).spoken(name)
    assert TrackLanguage(name.partition("-")[0]).spoken(language)
    assert not TrackLanguage("nl").spoken(name)


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


@pytest.mark.parametrize(
    ("name", "heard", "spoken", "kind"),
    [
        ("en-orig", "en-orig sv-orig", "sv", ("translated", "sv", "asr")),
        ("en", "en-orig sv-orig", "sv", ("translated", "sv", "asr")),
        ("en-US-orig", "en-US-orig", "pt-BR", ("translated", "pt-BR", "asr")),
        ("sv-orig", "en-orig sv-orig", "sv", ("asr", "sv", "asr")),
        ("en-orig", "en-orig", "en-GB", ("asr", "en", "asr")),
        ("en-orig", "en-orig de-orig", None, ("translated", "de", "asr")),
        ("iw-orig", "iw-orig", "he", ("asr", "iw", "asr")),
        ("en-orig", "en-orig", "zxx", ("asr", "en", "asr")),
    ],
)
def test_what_recognition_heard_in_a_dub_is_a_translation(
    name: str, heard: str, spoken: str | None, kind: tuple[str, str, str]
) -> None:
    automatic = frozenset([*heard.split(), "en", "sv"])
    listed = ListedTracks(frozenset(), automatic, spoken)
    assert kind_of(name, True, listed) == TrackKind(*kind)


def test_files_of_one_name_size_and_time_are_told_apart_by_their_content(job: Job) -> None:
    """Three videos in folders of their own, with subtitles that say the same and a playlist each;
    a copy of them is nothing new, wherever it lies.
    """
    folder, track = job.place / "videos", vtt(spoken("we build a farm"), automatic=True)
    about = {"_type": "playlist", "title": "x", "extractor_key": "YoutubeTab", "entries": []}
    for number in range(3):
        place = folder / str(number)
        place.mkdir(parents=True)
        (place / "video.info.json").write_text(json.dumps(info(video_id(number))))
        (place / "video.en.vtt").write_text(track)
        (place / "list.info.json").write_text(json.dumps(about | {"id": f"PL{number}"}))
    for path in folder.rglob("*.*"):
        os.utime(path, (1_790_000_000, 1_790_000_000))
    one = job.done("youtube", "import", str(folder))
    assert (one["crawled"], one["subtitles"], one["playlists"], one["files"]) == (3, 3, 3, 9)
    again = job.done("youtube", "import", str(folder))
    assert (again["files"], again["known_files"]) == (0, 9)
    assert job.done("youtube", "filter")["kept"] == 3
    shutil.copytree(folder, job.place / "copy", copy_function=shutil.copyfile)
    again = job.done("youtube", "import", str(job.place / "copy"))
    assert (again["files"], again["known_files"]) == (0, 9)


def test_a_file_is_opened_again_where_its_answer_is_lost_or_the_file_another_one(job: Job) -> None:
    folder = job.place / "videos"
    folder.mkdir()
    path, old = folder / "video.info.json", json.dumps(info(video_id(1)))
    path.write_text(old)
    about = path.stat()
    job.done("youtube", "import", str(folder))
    (segment,) = (job.root / "raw/youtube/ytdlp_info").glob("*.zst")
    path.write_text(old.replace(video_id(1), video_id(2)))
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
    assert path.stat().st_size == about.st_size
    assert job.done("youtube", "import", str(folder))["crawled"] == 1
    assert {one["response"]["id"] for one in job.raw("ytdlp_info")} == {video_id(1), video_id(2)}
    path.write_text(old)
    assert job.done("youtube", "import", str(folder))["known_files"] == 1
    notes = job.root / "state/youtube-import/files.stamps"
    noted = notes.read_bytes()
    segment.unlink()
    shutil.rmtree(job.root / "state")
    notes.parent.mkdir(parents=True)
    notes.write_bytes(noted + b"torn")
    assert job.done("youtube", "import", str(folder))["crawled"] == 1
    assert job.done("youtube", "import", str(folder))["known_files"] == 1
    assert notes.stat().st_size == len(noted) + 24


@pytest.mark.parametrize("kind", ["own_transcripts", "ytdlp_playlists"])
def test_what_no_crawl_can_fetch_is_to_be_imported_again(job: Job, kind: str) -> None:
    folder = job.place / "videos"
    key = write_video(folder, 1, ())
    (folder / f"{key}.json").write_text(json.dumps([{"start": 0, "end": 2, "text": "a torch"}]))
    listed = {"_type": "playlist", "id": "PL1", "title": "Farms", "extractor_key": "YoutubeTab"}
    playlist = {**listed, "entries": [info(key)]}
    (folder / "Farms [PL1].info.json").write_text(json.dumps(playlist))
    words = ("youtube", "import", str(folder), "--own-transcripts", str(folder))
    job.done(*words)
    before = job.raw(kind)
    assert before
    (segment,) = rawlog.segments(job.root, "youtube", kind)
    segment.write_bytes(segment.read_bytes()[:-3] + b"\xff\xff\xff")
    said = job.kb("verify", "--repair")
    assert said.returncode == 1
    (line,) = [line for line in said.stdout.splitlines() if "set aside as" in line]
    assert f"{kind} {segment.name}" in line
    assert "run `kb youtube import`" in line
    assert "youtube crawl" not in line
    assert "`kb youtube import`" in job.stopped("youtube", "filter", code=1)
    job.done(*words)
    assert job.raw(kind) == before
    job.done("youtube", "filter")
