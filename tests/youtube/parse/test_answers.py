"""Bad values: each is named with its column, reason and text; none costs another value or
raises.
"""

import json
from typing import Any

import pyarrow as pa
import pytest

from kb.core.errors import DamagedData, FatalError
from kb.schema import decode
from kb.store.tables.columns import word_count
from kb.youtube.parse import answers as parse
from kb.youtube.parse.assemble import assemble, with_tracks
from tests.filters.made import change_at, cues

GOOD: dict[str, Any] = {
    "id": "a",
    "snippet": {"title": "t", "publishedAt": "2007-08-23T00:34:43Z", "categoryId": "20"},
    "contentDetails": {"duration": "PT1M"},
    "statistics": {"viewCount": "7"},
    "player": {"embedWidth": "854", "embedHeight": "480"},
}


def line(items: Any, ids: Any = None, status: int = 200) -> bytes:
    params = {} if ids is None else {"id": ids}
    return json.dumps(
        {
            "fetched_at": "2026-11-20T12:00:00Z",
            "request": {"endpoint": "videos.list", "params": params},
            "status": status,
            "response": {"items": items},
        }
    ).encode()


def rows(*lines: bytes) -> list[dict[str, Any]]:
    return [row for table in parse.videos(lines) for row in table.to_pylist()]


def changed(path: str, value: Any) -> dict[str, Any]:
    item = json.loads(json.dumps(GOOD))
    change_at(item, path.split("."), value)
    return item


@pytest.mark.parametrize(
    ("path", "value", "column", "text"),
    [
        ("statistics.viewCount", "", "view_count", ""),
        ("statistics.viewCount", "-5", "view_count", "-5"),
        ("statistics.viewCount", "12a", "view_count", "12a"),
        ("statistics.viewCount", " 12", "view_count", " 12"),
        ("statistics.viewCount", "1.5", "view_count", "1.5"),
        ("statistics.viewCount", "٣", "view_count", "٣"),
        ("statistics.viewCount", "9" * 30, "view_count", "9" * 30),
        ("statistics.viewCount", 12, "view_count", "12"),
        ("statistics.viewCount", ["7"], "view_count", '["7"]'),
        ("statistics", "7", "view_count", "7"),
        ("contentDetails.duration", "P", "duration_s", "P"),
        ("contentDetails.duration", "PT", "duration_s", "PT"),
        ("contentDetails.duration", "", "duration_s", ""),
        ("contentDetails.duration", "1:30", "duration_s", "1:30"),
        ("contentDetails.duration", "P1Y", "duration_s", "P1Y"),
        ("contentDetails.duration", "PT-5S", "duration_s", "PT-5S"),
        ("contentDetails.duration", 60, "duration_s", "60"),
        ("snippet.publishedAt", "yesterday", "published_at", "yesterday"),
        ("snippet.publishedAt", "2019-02-30T00:00:00Z", "published_at", "2019-02-30T00:00:00Z"),
        ("snippet.publishedAt", "2019-02-03", "published_at", "2019-02-03"),
        ("snippet.categoryId", "twenty", "category_id", "twenty"),
        ("snippet.title", {"a": 1}, "title", '{"a": 1}'),
        ("snippet.tags", "minecraft", "tags", "minecraft"),
        ("snippet.tags", ["a", 1], "tags", '["a", 1]'),
        ("contentDetails.caption", "maybe", "caption", "maybe"),
        ("player.embedWidth", "-1", "embed_width", "-1"),
        ("player.embedWidth", "wide", "embed_width", "wide"),
    ],
)
def test_a_malformed_value(path: str, value: Any, column: str, text: str) -> None:
    bad, good = rows(line([changed(path, value), GOOD | {"id": "b"}]))
    found = [problem for problem in bad["problems"] if problem["column"] == column]
    assert found == [{"column": column, "reason": "malformed", "value": text}]
    assert bad[column] in (None, [])
    assert good["problems"] == []
    assert (good["view_count"], good["duration_s"], good["category_id"]) == (7, 60, 20)


@pytest.mark.parametrize(
    ("path", "column"),
    [
        ("statistics.viewCount", "view_count"),
        ("statistics", "view_count"),
        ("contentDetails", "duration_s"),
        ("contentDetails.duration", "duration_s"),
    ],
)
def test_an_absent_value_that_a_stage_needs(path: str, column: str) -> None:
    for value in (KeyError, None):
        row = rows(line([changed(path, value)]))[0]
        assert row["problems"] == [{"column": column, "reason": "absent", "value": None}]
        assert row[column] is None


def test_a_hidden_like_count_and_no_tags_are_no_problem() -> None:
    row = rows(line([GOOD]))[0]
    assert (row["like_count"], row["tags"], row["problems"]) == (None, [], [])


@pytest.mark.parametrize(
    ("duration", "seconds"),
    [
        ("P0D", 0),
        ("PT0S", 0),
        ("PT21M7S", 1267),
        ("PT10H", 36_000),
        ("P1DT2H3M4S", 93_784),
        ("P2W", 1_209_600),
        ("P1W1DT1S", 691_201),
        ("PT90M", 5_400),
    ],
)
def test_durations(duration: str, seconds: int) -> None:
    assert rows(line([changed("contentDetails.duration", duration)]))[0]["duration_s"] == seconds


def test_nul_and_lone_surrogates_become_replacement_characters() -> None:
    item = changed("snippet.title", "a\x00b\ud800c ☃ 😀")
    item["snippet"]["tags"] = ["\udfff", "x\x00"]
    row = rows(line([item, GOOD | {"id": "b"}]))
    assert row[0]["title"] == "a\ufffdb\ufffdc ☃ 😀"
    assert row[0]["tags"] == ["\ufffd", "x\ufffd"]
    assert row[1]["title"] == "t"
    assert row[0]["problems"] == []


def test_retyped_parents_cost_one_record_only() -> None:
    items = [
        GOOD | {"id": "a", "snippet": None},
        GOOD | {"id": "b", "snippet": "gone"},
        GOOD | {"id": "c"},
        "not a record",
        None,
    ]
    got = rows(line(items, "a,b,c"))
    assert [row["video_id"] for row in got] == ["a", "b", "c"]
    assert got[0]["title"] is None
    assert got[0]["problems"] == []
    assert {problem["column"] for problem in got[1]["problems"]} >= {
        "title",
        "category_id",
        "published_at",
    }
    assert got[2]["problems"] == []


def test_missing_ids() -> None:
    got = rows(line([GOOD], "a,b,c"), line([], ["d"]), line(None, "e"))
    assert [(row["video_id"], row["missing"]) for row in got] == [
        ("a", False),
        ("b", True),
        ("c", True),
        ("d", True),
        ("e", True),
    ]
    assert parse.missing({"id": "a,b"}, {"items": [GOOD]}) == ["b"]
    assert parse.requested({"id": ""}) == [] == parse.requested({})


def test_an_item_without_a_readable_id_counts_as_missing() -> None:
    got = rows(line([GOOD | {"id": None}, GOOD | {"id": {"x": 1}}], "a,b"))
    assert [(row["video_id"], row["missing"]) for row in got] == [("a", True), ("b", True)]


def test_batches_are_bounded_and_say_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [
        line(
            [GOOD | {"id": f"{number}-{index}"} for index in range(50)], f"{number}-0,gone{number}"
        )
        for number in range(20)
    ]
    whole = rows(*lines)
    monkeypatch.setattr(decode, "JSON_BYTES", len(lines[0]) + 1)
    small = list(parse.videos(lines))
    assert max(table.num_rows for table in small) == 100
    key = lambda row: row["video_id"]  # noqa: E731
    assert sorted([row for table in small for row in table.to_pylist()], key=key) == sorted(
        whole, key=key
    )
    assert len({str(table.schema) for table in small}) == 1


def test_a_line_that_is_no_envelope() -> None:
    for bad in (b"{", b"[]", b'{"a": 1}', b"\xff"):
        with pytest.raises(DamagedData, match="not an envelope"):
            rows(bad)


def test_transcripts_of_every_outcome() -> None:
    def outcome(**response: Any) -> bytes:
        return json.dumps(
            {
                "fetched_at": "2026-11-20T12:00:00Z",
                "request": {"endpoint": "transcript", "params": {}},
                "status": 200,
                "response": {"format": parse.FORMAT, **response},
            }
        ).encode()

    odd = {"start_s": [0], "duration_s": ["x"], "text": ["y"]}
    lines = [
        outcome(
            video_id="a",
            outcome="ok",
            kind="asr",
            language="en",
            cues=cues([0, 1.5, "hi"], [1, 2, "a\x00b"]),
            player={"fps": 60, "game_label_id": "UC1"},
        ),
        outcome(video_id="b", outcome="disabled", player=None),
        outcome(video_id="c", outcome="ok", kind="manual", language="en-GB", cues=odd),
        outcome(video_id="d", outcome="ok", kind="manual", language="en", cues=cues()),
    ]
    table = pa.concat_tables(parse.transcripts(lines))
    # What has no words in it, or can't be read, is no transcript.
    assert with_tracks(assemble({"transcripts": table}, words=word_count))["youtube/transcripts"][
        "video_id"
    ].to_pylist() == ["a"]
    a, b, c, d = table.to_pylist()
    assert a["cues"] == [
        {"start_s": 0.0, "duration_s": 1.5, "text": "hi", "word_start_s": None},
        {"start_s": 1.0, "duration_s": 2.0, "text": "a\ufffdb", "word_start_s": None},
    ]
    assert (a["player_fps"], a["game_label_id"], a["player_width"], a["problems"]) == (
        60,
        "UC1",
        None,
        [],
    )
    assert (b["outcome"], b["cues"], b["kind"]) == ("disabled", None, None)
    assert b["problems"] == []
    assert c["cues"] is None
    assert c["problems"] == [{"column": "cues", "reason": "malformed", "value": json.dumps(odd)}]
    assert d["cues"] == []


@pytest.mark.parametrize("number", [None, 1, 3])
def test_transcripts_of_another_raw_format_are_refused(number: int | None) -> None:
    answer = {"format": number, "video_id": "a", "outcome": "ok", "cues": [[0, 1, "hi"]]}
    line = {"fetched_at": None, "request": {"params": {}}, "status": 200, "response": answer}
    with pytest.raises(FatalError, match=f"raw format {number or 1}; .* reads format 2") as caught:
        list(parse.transcripts([json.dumps(line).encode()]))
    assert "new data root" in caught.value.hint
