"""`kb youtube export --format text`: a JSON line a video."""

import json
from pathlib import Path

import pyarrow as pa

from kb.export import flat_text
from kb.schema.tables import table


def test_a_line_has_what_was_said(tmp_path: Path, make_rows, run_at, fill) -> None:
    said = [["so we", "build a “house” ☃"], [], ["one\nline"]]
    kind = table("youtube/transcripts").arrow().field("cues").type
    cues = pa.array(
        [
            [{"start_s": 1.0 * at, "duration_s": 1.0, "text": text} for at, text in enumerate(one)]
            for one in said
        ],
        kind,
    )
    videos = make_rows("youtube/videos", 3, title=['a "b"', "c", "d"])
    ids = videos["video_id"].to_pylist()
    fill(tmp_path, "youtube/videos", videos, 2)
    fill(
        tmp_path,
        "youtube/transcripts",
        make_rows("youtube/transcripts", 3, video_id=ids, cues=cues),
        2,
    )
    summary = flat_text.youtube(run_at(tmp_path))
    path = tmp_path / "export/text/youtube.jsonl"
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert [line["id"] for line in lines] == ids
    assert [line["text"] for line in lines] == ["so we build a “house” ☃", "", "one\nline"]
    assert lines[0]["title"] == 'a "b"'
    assert set(lines[0]) == {"id", "text", "language", "kind", "title", "link"}
    assert summary["videos"] == 3
    before = path.read_bytes()
    flat_text.youtube(run_at(tmp_path))
    assert path.read_bytes() == before
    assert not (tmp_path / "release").exists()
