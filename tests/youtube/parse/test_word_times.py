"""Word times of automatic tracks: used where there is one for each word, in order."""

import json

import pyarrow as pa
import pytest

from kb.annotate.word_count import word_count_of_lists
from kb.youtube.parse import answers as parse
from kb.youtube.parse.assemble import assemble


def track(kind: str, *cues: list[object]) -> dict[str, object]:
    """The row of youtube/transcripts that an answer with these cues becomes."""
    answer = {
        "video_id": "a",
        "outcome": "ok",
        "kind": kind,
        "original_kind": "manual" if kind == "manual" else "asr",
        "language": "en",
        "cues": cues,
    }
    request = {"endpoint": "transcript", "params": {}}
    envelope = {"fetched_at": "2026-11-20T12:00:00Z", "request": request, "status": 200}
    line = json.dumps({**envelope, "response": answer}).encode()
    table = pa.concat_tables(parse.transcripts([line]))
    (row,) = assemble({"transcripts": table}, words=word_count_of_lists)[
        "youtube/transcripts"
    ].to_pylist()
    return row


@pytest.mark.parametrize(
    ("times", "why"),
    [
        ([0, 0.5], "complete"),
        ([0.5, 0.5], "complete"),
        (None, "absent"),
        ([0], "mismatch"),
        ([0, 1, 2], "mismatch"),
        ([], "mismatch"),
        ("soon", "mismatch"),
        ([0, "x"], "mismatch"),
        ([0, None], "mismatch"),
        ([-1, 0.5], "negative"),
        ([0.5, 0.25], "unordered"),
    ],
)
def test_a_cue_whose_times_do_not_fit_keeps_its_text(times: object, why: str) -> None:
    row = track("asr", [0, 1, " said twice ", times], [2, 1, "fine", [2]])
    first, second = row["cues"]
    assert (first["text"], second["word_start_s"]) == (" said twice ", [2])
    assert first["word_start_s"] == (times if why == "complete" else None)
    assert row["word_times"] == why


@pytest.mark.parametrize("kind", ["manual", "translated"])
def test_other_tracks_have_none(kind: str) -> None:
    row = track(kind, [0, 1, "said twice", [0, 0.5]])
    assert (row["cues"][0]["word_start_s"], row["word_times"]) == (None, None)


def test_older_answers_have_none() -> None:
    row = track("asr", [0, 1, "said twice"], [1, 1, ""])
    assert [cue["word_start_s"] for cue in row["cues"]] == [None, None]
    assert row["word_times"] == "absent"
