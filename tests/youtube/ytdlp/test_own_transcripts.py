"""Transcripts of one's own speech recognition: of every program, under every name, and beside those
of YouTube.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.sandbox.domains import of_case
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import video_id, write_video

SAID = ["so today we build an iron farm", "it needs 3 villagers and", "a diamond pickaxe"]
VIDEOS = "SELECT * FROM clean.youtube_videos ORDER BY video_id"
TRACKS = "SELECT * FROM clean.youtube_transcripts ORDER BY video_id"


def segments(word_ms: int = 300) -> list[dict[str, Any]]:
    """Segments of two seconds and a half, a word every `word_ms`."""
    made = []
    for number, text in enumerate(SAID):
        start = 2.5 * number
        words = [
            {"start": round(start + place * word_ms / 1000, 3), "word": word, "end": start + 2.4}
            for place, word in enumerate(text.split())
        ]
        made.append({"start": start, "end": start + 2.4, "text": text, "words": words})
    return made


def whisper() -> str:
    found = segments()
    for one in found:
        one["text"] = f" {one['text']}"
        one |= {"id": 0, "seek": 0, "tokens": [50364], "temperature": 0.0}
        for word in one["words"]:
            word |= {"word": f" {word['word']}", "probability": 0.9}
    return json.dumps({"text": " ".join(SAID), "segments": found, "language": "en"})


def whisperx() -> str:
    found = segments()
    for one in found:
        for word in one["words"]:
            word["score"] = 0.8
            if word["word"] == "3":  # what is no letter is not aligned
                del word["start"], word["end"]
    every = [word for one in found for word in one["words"]]
    return json.dumps({"segments": found, "word_segments": every})


def faster_whisper(words: bool = True) -> str:
    found = [one | {"words": one["words"] if words else None} for one in segments()]
    return json.dumps(found)


def srt() -> str:
    times = ("00:00:00,000 --> 00:00:02,400", "00:00:02,500 --> 00:00:04,900")
    times += ("00:00:05,000 --> 00:00:07,400",)
    blocks = zip(range(1, 4), times, SAID, strict=True)
    return "".join(f"{number}\n{time}\n{text}\n\n" for number, time, text in blocks)


def underlined_srt() -> str:
    """Whisper's --highlight_words: each word underlined for a while, nothing between."""
    blocks = []
    for number, text in enumerate(SAID):
        words = text.split()
        for place in range(len(words)):
            for shown, ms in ((f"<u>{words[place]}</u>", 0), (words[place], 250)):
                line = " ".join([*words[:place], shown, *words[place + 1 :]])
                start = 2_500 * number + 300 * place + ms
                end = start + (250 if ms == 0 else 50)
                times = (f"00:00:0{at // 1000},{at % 1000:03}" for at in (start, end))
                blocks.append(f"{len(blocks) + 1}\n{' --> '.join(times)}\n{line}\n\n")
    return "".join(blocks)


def whisper_vtt() -> str:
    return "WEBVTT\n\n" + "".join(
        f"00:0{2.5 * number:.3f} --> 00:0{2.5 * number + 2.4:.3f}\n{text}\n\n"
        for number, text in enumerate(SAID)
    )


# name of the file, its text, whether it has times of words
FILES = [
    ("{id}.json", whisper, True),
    ("A title [{id}].json", whisperx, True),
    ("{id}/audio.json", faster_whisper, True),
    ("{id}/audio.en.json", lambda: faster_whisper(words=False), False),
    ("a/Some title v1.5 [{id}].srt", srt, False),
    ("a/Some title-{id}.en-US.vtt", whisper_vtt, False),
    ("a/{id}.f140.m4a.srt", srt, False),
    ("a/{id}.srt", underlined_srt, False),
]


def write(place: Path, name: str, text: str) -> None:
    path = place / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_of_every_program_and_under_every_name(job: Job) -> None:
    folder, own = job.place / "videos", job.place / "videos/whisper"
    licence = {"license": "Creative Commons Attribution license (reuse allowed)"}
    for number in range(len(FILES)):
        write_video(folder, number, (), view_count=1_000 + number, **licence)
    write_video(folder, len(FILES), ("vtt",), **licence)
    assert job.done("youtube", "import", str(folder))["crawled"] == len(FILES) + 1
    assert job.done("youtube", "filter")["pending"] == len(FILES)
    assert job.kb("youtube", "missing-transcripts").stdout.split() == [
        video_id(number) for number in reversed(range(len(FILES)))
    ]
    for number, (name, text, _) in enumerate(FILES):
        write(own, name.format(id=video_id(number)), text())
    summary = job.done("youtube", "import", str(folder), "--own-transcripts", str(own))
    assert (summary["own_transcripts"], summary["unknown_videos"]) == (len(FILES), 0)
    again = job.done("youtube", "import", "--own-transcripts", str(own))
    assert (again["files"], again["known_files"]) == (0, len(FILES))

    assert job.done("youtube", "filter")["kept"] == len(FILES) + 1
    assert job.kb("youtube", "missing-transcripts").stdout == ""
    rows, tracks = job.rows(VIDEOS), job.rows(TRACKS)
    assert [(row["transcript_kind"], row["transcript_origin"]) for row in rows] == [
        *[("asr", "own")] * len(FILES),
        ("asr", "service"),
    ]
    for (name, _, timed), track in zip(FILES, tracks, strict=False):
        cues = track["cues"]
        assert [cue["text"] for cue in cues] == SAID, name
        assert [cue["start_s"] for cue in cues] == [0, 2.5, 5], name
        assert (track["language"][:2], track["word_times"]) == (
            "en",
            "complete" if timed else "absent",
        ), name
        if timed:
            assert cues[1]["word_start_s"] == [2.5, 2.8, 3.1, 3.4, 3.7], name
    job.done("pairs")
    pairs = job.rows("SELECT DISTINCT video_id, timing FROM pairs ORDER BY ALL")
    assert [row["timing"] for row in pairs][: len(FILES)] == [
        "word" if timed else "cue" for _, _, timed in FILES
    ]
    job.profile(("[release]", "[release]\nopen_text = true"))
    job.done("youtube", "export")
    job.done("release")
    card = " ".join((job.root / "release/youtube/README.md").read_text().split())
    assert f"The transcripts of {len(FILES)} of {len(FILES) + 1} videos" in card
    open_ = job.rows("SELECT video_id FROM release.open_text")
    assert [row["video_id"] for row in open_] == [video_id(len(FILES))]


def test_they_fill_come_first_or_are_ignored_as_the_profile_says(job: Job) -> None:
    video = of_case(job.sandbox.world.youtube, "manual")[0]
    before, locked = video.tracks, video.id
    video.tracks = [replace(track, po_token=True) for track in before]
    job.done(*CRAWL)
    video.tracks = before
    job.done("youtube", "filter")
    had = job.rows(VIDEOS)[0]["video_id"]
    own = job.place / "own"
    for key in (locked, had):
        write(own, f"{key}.json", whisper())
    write(own, f"{locked}.srt", srt())  # Whisper writes every form
    write(own, f"{locked}.tsv", "start\tend\ttext")
    write(own, "nobody.json", whisper())
    write(own, f"{video_id(1)}.json", whisper())
    write(own, f"{had}.vtt", "WEBVTT\n\n00:00.000 --> 00:01.000\n\n")
    write(own, f"{had}.en.json", '{"text": "so", "segments": "many"}')
    write(own, f"{had}.de.json", whisper())  # not in the language
    found = job.done("youtube", "import", "--own-transcripts", str(own))
    assert (found["own_transcripts"], found["unknown_videos"], found["left_out_by"]) == (
        5,
        1,
        {"broken_transcripts": 2, "without_video_id": 1, "other_files": 1},
    )
    without, empty = sorted(found["left_out_files"]["broken_transcripts"])
    assert without.startswith(f"{had}.en.json (it has no segments with times in a form of whisper")
    assert empty == f"{had}.vtt (no cue in it)"
    asked = (
        "SELECT video_id, transcript_origin, word_count, topic_evidence FROM clean.youtube_videos"
    )
    seen, last = {}, ""
    for mode in ("fill", "prefer", "ignore"):
        setting = f'[youtube]\nown_transcripts = "{mode}"\n'
        job.profile((last or "[youtube]\n", setting))
        last = setting
        job.done("youtube", "filter")
        seen[mode] = {row["video_id"]: row for row in job.rows(asked)}
    origins = {
        mode: [rows.get(key, {}).get("transcript_origin") for key in (locked, had)]
        for mode, rows in seen.items()
    }
    assert origins == {
        "fill": ["own", "service"],
        "prefer": ["own", "own"],
        "ignore": [None, "service"],
    }
    # What the watch page said of a video stays.
    assert seen["fill"][locked]["topic_evidence"] == "game_label"
    others = {key for key in seen["ignore"] if key != had}
    assert all(seen["prefer"][key] == seen["ignore"][key] for key in others)
    gone = job.place / "gone.txt"
    gone.write_text(locked)
    job.done("purge", "youtube", "--ids", str(gone))
    assert {one["response"]["video_id"] for one in job.raw("own_transcripts")} == {
        had,
        video_id(1),
    }


def test_a_folder_may_hold_both(job: Job) -> None:
    """Whisper, run where yt-dlp wrote to: names without a language are its own."""
    folder = job.place / "videos"
    first, second = (write_video(folder, number, ()) for number in (1, 2))
    (folder / f"{first}.en.srt").write_text(srt())  # yt-dlp's --convert-subs srt
    (folder / f"Title 2 [{second}].srt").write_text(srt())
    (folder / f"Title 2 [{second}].json").write_text(whisper())
    both = (str(folder), "--own-transcripts", str(folder))
    found = job.done("youtube", "import", *both)
    counts = (found["subtitles"], found["own_transcripts"], found["left_out_by"])
    assert counts == (1, 2, {})
    job.done("youtube", "filter")
    assert [row["transcript_origin"] for row in job.rows(VIDEOS)] == ["service", "own"]


@pytest.mark.parametrize("words", [(), ("--own-transcripts", "nowhere")])
def test_without_a_folder_nothing_is_written(job: Job, words: tuple[str, ...]) -> None:
    assert "folder" in job.stopped("youtube", "import", *words, code=2)
    assert not job.root.exists()


NAMES = {
    "{id}.eng.srt": True,
    "{id}.en-001.json": True,
    "A title [{id}].en_GB.vtt": True,
    "{id}/audio.EN.srt": True,
    "a/{id}.mp4.eng.srt": True,
    "{id}.swe.srt": False,
    "{id}.zh-Hant.srt": False,
    "a/A title [{id}].es-419.json": False,
    "A title [{id}].English.json": True,
    "{id}.german.vtt": False,
}


def test_languages_in_names_are_read_as_languages_and_others_are_named(job: Job) -> None:
    """By their names the same for one's own files and for those beside info.json."""
    folder, own = job.place / "videos", job.place / "own"
    for number, name in enumerate(NAMES):
        write_video(folder, number, (), view_count=1_000 + number)
        form = {"json": faster_whisper, "srt": srt, "vtt": whisper_vtt}[name.rpartition(".")[2]]
        write(own, name.format(id=video_id(number)), form())
    summary = job.done("youtube", "import", str(folder), "--own-transcripts", str(own))
    assert (summary["own_transcripts"], summary["left_out_by"]) == (len(NAMES), {})
    assert summary["other_languages"] == {"sv": 1, "zh-Hant": 1, "es-419": 1, "de": 1}
    key = video_id([*NAMES].index("{id}.swe.srt"))
    assert f"{key}.swe.srt (sv)" in summary["other_language_files"]
    job.done("youtube", "filter")
    assert [row["transcript_origin"] == "own" for row in job.rows(VIDEOS)] == [
        used for used in NAMES.values() if used
    ]
    assert {row["language"].partition("-")[0] for row in job.rows(TRACKS)} == {"en"}


def test_subtitles_beside_info_json_say_why_they_are_not_used(job: Job) -> None:
    folder = job.place / "videos"
    names = ("eng.srt", "swe.srt", "srt", "en_US.srt", "ass", "English.srt")
    for number, name in enumerate(names):
        key = write_video(folder, number, ())
        (folder / f"{key}.{name}").write_text(srt())
    summary = job.done("youtube", "import", str(folder))
    assert summary["left_out_by"] == {"without_language": 1, "other_subtitles": 1}
    assert summary["left_out_files"]["without_language"] == [f"{video_id(2)}.srt"]
    assert summary["other_language_files"] == [f"{video_id(1)}.swe.srt (sv)"]
    job.done("youtube", "filter")
    languages = {row["video_id"]: row["language"] for row in job.rows(TRACKS)}
    assert languages == {video_id(0): "en", video_id(3): "en-US", video_id(5): "en"}


@pytest.mark.parametrize("wanted", ["en-GB", "eng-us"])
def test_tracks_of_the_profiles_region_come_first(job: Job, wanted: str) -> None:
    folder = job.place / "videos"
    key = write_video(folder, 1, ())
    for language in ("en-GB", "en-US"):
        (folder / f"{key}.{language}.srt").write_text(srt())
    job.profile(('language = "en"', f'language = "{wanted}"'))
    job.done("youtube", "import", str(folder))
    job.done("youtube", "filter")
    assert [row["language"] for row in job.rows(TRACKS)] == [wanted.replace("eng-us", "en-US")]


def test_a_language_that_is_none_is_named(job: Job) -> None:
    job.profile(('language = "en"', 'language = "english"'))
    assert "'english' is no code of a language" in job.stopped("youtube", "filter", code=2)
