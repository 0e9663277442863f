"""Transcripts as documents for language models: paragraphs that end where the talk pauses, a time
at each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path

import pyarrow as pa

from kb.core.installation import np, pc
from kb.export.text import TextDocument, TextFiles, TextPiece
from kb.store.tables import parquet

PAUSE_S = 2.0  # silence that ends a paragraph, however short
MOST, LEAST = 120, 60  # words of a paragraph, and words before which no shorter pause ends one
_ROWS = 256  # transcripts at a time
_CUES = [f"cues.list.element.{name}" for name in ("start_s", "duration_s", "text")]
_VIDEO = (
    *("video_id", "title", "link", "license", "published_at", "fetched_at"),
    *("channel_id", "channel_title", "duration_s", "transcript_origin"),
)


def documents(files: TextFiles) -> Iterator[TextDocument]:
    """The kept videos with a transcript of one bucket, by id. Raises DamagedData."""
    videos = (parquet.read_table(path, _VIDEO) for path in files["youtube/videos"])
    by_id = {video["video_id"]: video for rows in videos for video in rows.to_pylist()}
    (spoken,) = files["youtube/transcripts"]
    with parquet.open_file(Path(spoken)) as file:
        for batch in file.iter_batches(_ROWS, columns=["video_id", "kind", "language", *_CUES]):
            for row, pieces in _spoken(batch):
                if (video := by_id.get(row["video_id"])) is None:
                    continue
                more = ("channel_id", "channel_title", "duration_s", "transcript_origin")
                yield TextDocument(
                    row["video_id"],
                    video["title"] or row["video_id"],
                    pieces,
                    video["fetched_at"],
                    video["published_at"],
                    {
                        "url": video["link"],
                        "license": video["license"],
                        "language": row["language"],
                        "kind": row["kind"],
                        **{name: video.get(name) for name in more},
                    },
                )


def _spoken(batch: pa.RecordBatch) -> Iterator[tuple[dict[str, str], list[TextPiece]]]:
    lists = batch["cues"]
    counts = pc.fill_null(pc.list_value_length(lists), 0).to_pylist()
    cues = pc.list_flatten(lists)
    starts, lengths = (
        pc.fill_null(pc.struct_field(cues, [name]), 0.0).to_numpy(zero_copy_only=False)
        for name in ("start_s", "duration_s")
    )
    spoken = pc.fill_null(pc.struct_field(cues, ["text"]), "")
    words = pc.add(pc.count_substring(spoken, " "), 1).to_numpy(zero_copy_only=False)
    texts = spoken.to_pylist()
    names = batch.select(["video_id", "kind", "language"]).to_pylist()
    for row, (begin, end) in zip(names, pairwise(accumulate(counts, initial=0)), strict=True):
        part = slice(begin, end)
        yield row, paragraphs(starts[part], lengths[part], words[part], texts[part])


def paragraphs(
    starts: np.ndarray, lengths: np.ndarray, words: np.ndarray, texts: Sequence[str]
) -> list[TextPiece]:
    """Cues as paragraphs: one ends at each pause of PAUSE_S, and after at most MOST words, at the
    longest pause behind its first LEAST. A longer cue is a paragraph.
    """
    pieces: list[TextPiece] = []
    pauses = np.maximum(starts[1:] - (starts[:-1] + lengths[:-1]), 0)
    breaks = [*(np.flatnonzero(pauses >= PAUSE_S) + 1).tolist(), len(texts)]
    behind = np.cumsum(words)  # words until the end of each cue
    begin = 0
    for stop in breaks:
        while begin < stop:
            before = int(behind[begin] - words[begin])
            end = stop
            if behind[stop - 1] - before > MOST:
                end = max(int(np.searchsorted(behind, before + MOST, "right")), begin + 1)
                first = int(np.searchsorted(behind, before + LEAST)) + 1  # one past the cue
                some = pauses[first - 1 : end] if begin < first <= end else pauses[:0]
                if len(some):  # of equal pauses the last
                    end = first + len(some) - 1 - int(np.argmax(some[::-1]))
            text = " ".join(texts[begin:end])
            if "\n" in text or "  " in text or not text.isprintable():
                text = " ".join(text.split())
            if text and not text.isspace():
                at = max(int(starts[begin]), 0)
                pieces.append(TextPiece(f"[{at // 60:02d}:{at % 60:02d}] {text}", begins=True))
            begin = end
    return pieces
