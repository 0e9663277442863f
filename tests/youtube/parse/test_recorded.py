"""Every recorded answer of YouTube goes through the code that reads live ones; values are held
against the file.
"""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from kb.youtube.crawl.player import facts
from kb.youtube.parse import answers as parse
from tests.filters import made

WHEN = "2026-11-20T12:00:00Z"
VIDEOS = [
    "video_api_response",
    "videos_info_multi",
    "videos_info_single",
    "videos_chart_paged_1",
    "videos_chart_paged_2",
]


def line(response: Any, params: dict[str, Any] | None = None, status: int = 200) -> bytes:
    envelope = {
        "fetched_at": WHEN,
        "request": {"endpoint": "videos.list", "params": params or {}},
        "status": status,
        "response": response,
    }
    return json.dumps(envelope).encode()


def load(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", VIDEOS)
def test_videos_field_by_field(name: str, recorded: Path) -> None:
    answer = load(recorded / "youtube" / "videos" / f"{name}.json")
    rows = pa.concat_tables(parse.videos([line(answer)])).to_pylist()
    assert len(rows) == len(answer["items"])
    for row, item in zip(rows, answer["items"], strict=True):
        snippet, statistics = item["snippet"], item.get("statistics", {})
        details, status = item.get("contentDetails", {}), item.get("status", {})
        assert row["video_id"] == item["id"]
        assert row["title"] == snippet["title"]
        assert row["description"] == snippet["description"]
        assert row["channel_id"] == snippet["channelId"]
        assert row["channel_title"] == snippet["channelTitle"]
        assert row["tags"] == snippet.get("tags", [])
        assert row["category_id"] == int(snippet["categoryId"])
        assert row["published_at"] == datetime.fromisoformat(snippet["publishedAt"])
        assert row["default_language"] == snippet.get("defaultLanguage")
        assert row["default_audio_language"] == snippet.get("defaultAudioLanguage")
        assert row["live_broadcast_content"] == snippet["liveBroadcastContent"]
        for column, field in (
            ("view_count", "viewCount"),
            ("like_count", "likeCount"),
            ("comment_count", "commentCount"),
        ):
            assert row[column] == (int(statistics[field]) if field in statistics else None)
        assert row["license"] == status.get("license")
        assert row["definition"] == details.get("definition")
        assert row["caption"] == (
            {"true": True, "false": False}[details["caption"]] if details else None
        )
        assert (row["embed_width"], row["embed_height"], row["yt_rating"]) == (None, None, None)
        assert row["fetched_at"] == datetime(2026, 11, 20, 12, tzinfo=UTC)
        assert row["missing"] is False
        absent = {problem["column"] for problem in row["problems"]}
        assert absent == (set() if statistics else {"view_count", "duration_s"})
        assert all(
            problem["reason"] == "absent" and problem["value"] is None
            for problem in row["problems"]
        )


def test_the_video_with_everything(recorded: Path) -> None:
    answer = load(recorded / "youtube" / "videos" / "video_api_response.json")
    row = next(parse.videos([line(answer)])).to_pylist()[0]
    assert row["video_id"] == "D-lhorsDlUQ"
    assert row["title"] == "What are Actions on Google (Assistant on Air)"
    assert (row["view_count"], row["like_count"], row["comment_count"]) == (7920, 190, 32)
    assert row["duration_s"] == 21 * 60 + 7
    assert row["published_at"] == datetime(2019, 3, 21, 20, 37, 49, tzinfo=UTC)
    assert (row["category_id"], row["license"], row["definition"], row["caption"]) == (
        28,
        "youtube",
        "hd",
        True,
    )
    assert len(row["tags"]) == 20
    assert row["tags"][:2] == ["Google", "developers"]


def test_playlist_items_are_listed_in_order(recorded: Path) -> None:
    folder = recorded / "youtube" / "playlist_items"
    first, second = (
        load(folder / "playlist_items_paged_1.json"),
        load(folder / "playlist_items_paged_2.json"),
    )
    ids = parse.listed(first) + parse.listed(second)
    assert len(ids) == 13 == len(set(ids))
    assert parse.listed(second)[0] == "6aSG8SdvkoU"
    assert ids == [
        item["snippet"]["resourceId"]["videoId"]
        for page in (first, second)
        for item in page["items"]
    ]
    assert parse.next_page(first) == first["nextPageToken"]
    assert parse.next_page(second) is None
    assert len(parse.listed(load(folder / "playlist_items_filter_video.json"))) == 1


def test_channel_hits(recorded: Path) -> None:
    answer = load(recorded / "youtube" / "search" / "search_channels.json")
    assert parse.channel_hits(answer) == [item["id"]["channelId"] for item in answer["items"]]
    assert parse.channel_hits(answer)[0] == "UCxRULEz6kS0PMxCzOY25GhQ"
    assert parse.next_page(answer) == "CAUQAA"
    # a search for videos gives their channels
    videos = load(recorded / "youtube" / "search" / "search_by_keywords_p1.json")
    assert len(parse.channel_hits(videos)) == 25


def test_an_empty_answer(recorded: Path) -> None:
    answer = load(recorded / "youtube" / "empty" / "subscription_zero.json")
    assert (parse.listed(answer), parse.channel_hits(answer)) == ([], [])
    rows = pa.concat_tables(parse.videos([line(answer, {"id": "a,b"})]))
    assert rows.filter(rows["missing"])["video_id"].to_pylist() == ["a", "b"]


def test_errors_are_no_rows(recorded: Path) -> None:
    for path in (recorded / "youtube" / "errors").glob("*.json"):
        answer = load(path)
        assert list(parse.videos([line(answer, {"id": "a"}, answer["error"]["code"])])) == []


def test_transcripts_of_recorded_timed_text(recorded: Path) -> None:
    from xml.etree import ElementTree

    root = ElementTree.fromstring(
        (recorded / "youtube" / "transcripts" / "transcript.xml").read_text(encoding="utf-8")
    )
    cues = [[float(one.attrib["start"]), float(one.attrib["dur"]), one.text or ""] for one in root]
    name = "youtube.innertube.json"
    player = facts(load(recorded / "youtube" / "transcripts" / name), "")
    answer = {
        "video_id": "GJLlxj_dtq8",
        "outcome": "ok",
        "kind": "manual",
        "language": "en",
        "format": parse.FORMAT,
        "cues": made.cues(*cues),
        "player": player,
    }
    row = next(parse.transcripts([line(answer)])).to_pylist()[0]
    assert [list(cue.values()) for cue in row["cues"]] == [[*cue, None] for cue in cues]
    assert len(cues) == 4
    assert (row["player_width"], row["player_height"], row["player_fps"]) == (3840, 2160, 24)
    assert (row["video_id"], row["outcome"], row["kind"], row["language"], row["problems"]) == (
        "GJLlxj_dtq8",
        "ok",
        "manual",
        "en",
        [],
    )
