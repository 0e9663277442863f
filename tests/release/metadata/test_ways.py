"""What card, datasheet, Croissant and deposit say of how the rows came to be: what was recorded,
for each way and for mixtures, and nothing else.
"""

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from kb.schema import table
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import START, build, filled
from tests.release.signed import LINES

EARLY = datetime(2026, 10, 20, tzinfo=UTC)
SEARCH = "Channels were found by keyword search in the YouTube Data API v3."
UPLOADS = "The uploads of channels were listed by that API."
WATCHED = "Public watch pages were read"
SUBTITLES = "Transcripts were taken from subtitle files"
TERMS = "YouTube's terms ask that data of its API"
CHOSEN = "How these videos were chosen is not recorded."
LARGE = "Search answers favour large channels."
DELETED = "made private or changed after the date of its file is not known here."
CREDENTIALS = "with the collector's own credentials"
ARCHIVED = "after an archive had retrieved it is not known"
EVERY = {SEARCH, UPLOADS, WATCHED, SUBTITLES, TERMS, LARGE, DELETED, CREDENTIALS, ARCHIVED}


def texts(root: Path, source: str) -> dict[str, str]:
    """Each document as one line."""
    folder = root / "release" / source
    made = {name: (folder / name).read_text() for name in ("README.md", "DATASHEET.md")}
    croissant = json.loads((folder / "croissant.json").read_text())
    made["croissant.json"] = json.dumps(croissant, ensure_ascii=False)
    made["zenodo.json"] = json.loads((folder / "zenodo.json").read_text())["metadata"][
        "description"
    ]
    return {
        name: " ".join(text.replace("&#x27;", "'").replace("\\_", "_").split())
        for name, text in made.items()
    }


def first_screen(root: Path) -> str:
    return (root / "release/youtube/README.md").read_text().partition("## Tables")[0]


def released_from(
    root: Path, source: str, raw: tuple[str, ...], own: int, value: dict[str, Any]
) -> dict[str, str]:
    """A release of which the first `own` rows of each table came in another way."""

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made[:own] if name.startswith(f"{source}/") else []:
            row.update({key: what for key, what in value.items() if key in row})
        if name.startswith("youtube/playlist"):
            made.clear()

    build(root, edit, (source, "pairs") if source == "youtube" else (source,))
    if {"transcripts", "ytdlp_subtitles"} & set(raw):
        tracks, of = table("youtube/transcripts"), [{"video_id": f"vid{n:08d}"} for n in range(60)]
        for number, row in enumerate(of):
            from_file = number < own
            row |= {"read_from": "file" if from_file else "watch_page"}
            row |= {"fetched_at": EARLY if from_file else START}
        made = pa.Table.from_pylist([filled(tracks, row) for row in of], tracks.arrow())
        write_table(Layout(root).table(tracks.name) / "part-00000.parquet", made, tracks)
    for kind in raw:
        segment = Layout(root).raw(source, kind) / "20261101T000000Z-0001.ndjson.zst"
        segment.parent.mkdir(parents=True, exist_ok=True)
        segment.write_bytes(b"")
    release(a_run(root))
    return texts(root, source)


FILE = {"metadata_origin": "file", "fetched_at": EARLY}
DUMP = {"score_source": "dump", "fetched_at": EARLY}
CRAWLED = ("search", "playlist_items", "videos", "transcripts")
IMPORTED = ("ytdlp_info", "ytdlp_subtitles")


@pytest.mark.parametrize(
    ("raw", "own", "said"),
    [
        (
            CRAWLED,
            0,
            {
                *(SEARCH, UPLOADS, WATCHED, TERMS, LARGE, "API v3 described all 60 videos"),
                "; all 60 transcripts are from them, read 2026-11-01.",
            },
        ),
        (("videos",), 0, {TERMS, "API v3 described all 60 videos", CHOSEN}),
        (
            IMPORTED,
            60,
            {
                SUBTITLES,
                DELETED,
                "for the collector described all 60 videos; their dates are 2026-10-20.",
                "for the collector: all 60 transcripts; their dates are 2026-10-20.",
                CHOSEN,
            },
        ),
        (
            (*CRAWLED, *IMPORTED),
            15,
            {
                *(SEARCH, UPLOADS, WATCHED, SUBTITLES, TERMS, LARGE, DELETED),
                "API v3 described 45 of 60 videos (75.0%)",
                "for the collector described 15 of 60 videos (25.0%)",
                "45 of 60 transcripts (75.0%) are from them, read 2026-11-01.",
                "for the collector: 15 of 60 transcripts (25.0%); their dates are 2026-10-20.",
            },
        ),
    ],
    ids=["crawl", "ids", "files", "both"],
)
def test_videos(tmp_path: Path, raw: tuple[str, ...], own: int, said: set[str]) -> None:
    found = released_from(tmp_path, "youtube", raw, own, FILE)
    assert_said(found, said)
    for source in ("youtube", "pairs"):
        card = (tmp_path / "release" / source / "README.md").read_text()
        assert re.search(r"^\| Read from the source \| 2026-", card, re.MULTILINE), source
    collection = {one for one in said if one not in (TERMS, LARGE, DELETED)}
    for name, text in texts(tmp_path, "pairs").items():  # how its videos came to be
        assert [one for one in collection if one not in text] == [], name
    (row,) = re.findall(r"^\| Rows came from \| (.*) \|$", first_screen(tmp_path), re.MULTILINE)
    if own == 15:
        assert row.split("; ") == [
            "the YouTube Data API, 45 of 60 videos (75.0%), 2026-11-01 to 2026-11-03",
            "files of yt-dlp, 15 of 60 videos (25.0%), 2026-10-20",
            "YouTube's watch pages, 45 of 60 transcripts (75.0%), 2026-11-01",
            "subtitle files of yt-dlp, 15 of 60 transcripts (25.0%), 2026-10-20",
        ]


@pytest.mark.parametrize(
    ("own", "value", "said"),
    [
        (0, DUMP, {CREDENTIALS, "is the source of all 60 posts and all 180 comments"}),
        (
            180,
            DUMP,
            {
                ARCHIVED,
                "all 60 posts and all 180 comments (`score_source` is dump), retrieved 2026",
            },
        ),
        (
            180,
            DUMP | {"fetched_at": None},
            {
                ARCHIVED,
                "; 240 rows don't say when they were retrieved (`fetched_at` is null).",
            },
        ),
        (
            30,
            DUMP,
            {CREDENTIALS, ARCHIVED, "30 of 60 posts (50.0%) and 30 of 180 comments (16.7%)"},
        ),
    ],
    ids=["api", "dumps", "undated dumps", "both"],
)
def test_posts(tmp_path: Path, own: int, value: dict[str, Any], said: set[str]) -> None:
    found = released_from(tmp_path, "reddit", (), own, value)
    assert_said(found, said)


@pytest.mark.parametrize(("raw", "listed"), [(("titles", "pages"), True), (("pages",), False)])
def test_pages(tmp_path: Path, raw: tuple[str, ...], listed: bool) -> None:
    for name, text in released_from(tmp_path, "wiki", raw, 0, {}).items():
        assert ("as the MediaWiki API lists them" in text) == listed, name
        assert ("lists of the collector's name" in text) != listed, name


def assert_said(found: dict[str, str], said: set[str]) -> None:
    """All of it, and nothing of another way; the deposit has the collection only."""
    for name, text in found.items():
        expected = said - {TERMS, LARGE, DELETED, ARCHIVED} if name == "zenodo.json" else said
        assert [one for one in expected if one not in text] == [], name
        assert [one for one in EVERY - said if one in text] == [], name


def test_the_build_has_a_date_only_where_one_is_set(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    for epoch, dated in ((None, False), (1_790_000_000, True)):
        release(a_run(tmp_path, source_date_epoch=epoch))
        folder = tmp_path / "release" / "youtube"
        for name, mark in {
            "README.md": "| Built | 2026-09-21 |",
            "DATASHEET.md": "built 2026-09-21",
            "CITATION.cff": "date-released: 2026-09-21",
            "croissant.json": '"datePublished": "2026-09-21"',
            "zenodo.json": '"publication_date": "2026-09-21"',
        }.items():
            text = (folder / name).read_text()
            assert (mark in text) == dated, name
            assert ("uilt 2026" in text or "| Built |" in text) == (dated and name.endswith(".md"))


QUESTIONS = {
    "funding": "Who funded the creation of the dataset?",
    "collectors": "Who was involved in the data collection, and how were they compensated?",
    "ethics_review": "Were any ethical review processes conducted?",
    "impact": "Has an analysis of the potential impact on the people concerned been conducted?",
    "sensitive_data": "Does it contain data that might be considered sensitive?",
    "third_parties": "Will it be distributed to third parties?",
    "third_party_rights": "Have third parties imposed restrictions on the data?",
    "export_controls": "Do export controls or other regulatory restrictions apply?",
    "erratum": "Is there an erratum?",
    "contributing": "Can others extend, augment or contribute to the dataset?",
    "uses_so_far": "Has the dataset been used for any tasks already?",
}


FLAGS = re.MULTILINE | re.DOTALL
OTHERS = (  # of "Datasheets for Datasets", what would be easy to leave out
    "Does the dataset identify any subpopulations?",
    "If the dataset is a sample, what was the sampling strategy?",
    "Was the data collected from the individuals directly, or obtained via third parties?",
    "If consent was obtained, can it be revoked?",
    "When will it be distributed?",
    "Are there limits on how long data about people may be kept?",
)


def test_the_authors_answers_are_in_the_datasheet(tmp_path: Path) -> None:
    build(tmp_path / "root", sources=("reddit",))
    profile = tmp_path / "mine.toml"
    for answered in (False, True):
        answers = {name: f"We say {number} <b>*" for number, name in enumerate(QUESTIONS)}
        lines = [f"datasheet.{name} = {json.dumps(text)}" for name, text in answers.items()]
        head = ['name = "mine"', 'title = "Mine"', "[release]", LINES]
        profile.write_text("\n".join(head + lines * answered) + "\n")
        release(a_run(tmp_path / "root", profile))
        sheet = (tmp_path / "root/release/reddit/DATASHEET.md").read_text()
        for number, question in enumerate(QUESTIONS.values()):
            said = f"We say {number} \\<b\\>\\*" if answered else "Not stated by the authors."
            assert f"**{question}**\n\n{said}\n" in sheet
        found = re.findall(r"^\*\*([^\n]+\?)\*\*\n\n(.*?)(?=^\*\*[^\n]+\?\*\*$|\Z)", sheet, FLAGS)
        assert [asked for asked, given in found if not given.partition("\n## ")[0].strip()] == []
        assert {asked for asked, _ in found} >= {*OTHERS, *QUESTIONS.values()}
        assert "**Is there a label or target associated with each instance?**\n\nNo." in sheet
