"""Reddit as a ConvoKit corpus (convokit.cornell.edu, corpus format): a folder that `Corpus(filename=…)` loads.

    utterances.jsonl     one post or comment a line: id, conversation_id, text, speaker, reply-to, timestamp, meta
    speakers.json        keyed hashes of authors         conversations.json   posts with their figures
    corpus.json          what the corpus is              index.json           types of the meta fields

Holds titles and bodies: it stays under export/ on the user's own disk and is never released.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.core.errors import FatalError
from kb.core.verdict import Summary
from kb.store.atomic import replacing_folder

if TYPE_CHECKING:
    from kb.core.context import Run

_GONE = "unknown"   # ConvoKit needs a speaker for every utterance


def export(run: Run) -> Summary:
    """clean/reddit → export/convokit/. Raises FatalError without clean rows, DiskFull. The same rows give the same bytes."""
    folder = run.root / "clean" / "reddit"
    if not any((folder / "posts").glob("*.parquet")):
        raise FatalError("nothing to export: clean/reddit has no posts", hint="run `kb reddit filter` first")
    speakers: set[str] = set()
    counts = {"posts": 0, "comments": 0}
    with replacing_folder(run.root / "export" / "convokit") as fresh:
        with (fresh / "utterances.jsonl").open("w", encoding="utf-8") as file, (fresh / "conversations.json").open("w", encoding="utf-8") as about:
            about.write("{")
            for table, row in _rows(folder):
                utterance = _post(row) if table == "posts" else _comment(row)
                file.write(json.dumps(utterance, ensure_ascii=False, sort_keys=True) + "\n")
                speakers.add(utterance["speaker"])
                if table == "posts":
                    meta = {"title": row["title"], "type": row["type"], "num_comments": row["num_comments"], "score": row["score"]}
                    about.write(("," if counts["posts"] else "") + f"\n{json.dumps(row['post_id'])}: " + json.dumps({"meta": meta, "vectors": []}, ensure_ascii=False))
                counts[table] += 1
            about.write("\n}\n")
        _write(fresh / "speakers.json", {name: {"meta": {}, "vectors": []} for name in sorted(speakers)})
        _write(fresh / "corpus.json", {"name": f"{run.profile.name}-reddit"})
        text, number = ["<class 'str'>"], ["<class 'int'>"]
        _write(fresh / "index.json", {
            "utterances-index": {"score": number, "depth": number, "type": text}, "speakers-index": {}, "overall-index": {"name": text},
            "conversations-index": {"title": text, "type": text, "num_comments": number, "score": number}, "vectors": [], "version": 1})
    return Summary(source="reddit", **counts, path=str(run.root / "export" / "convokit"))


def _rows(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Posts, each followed by its comments in order of id; memory is bounded by a batch."""
    import duckdb

    con = duckdb.connect()
    try:
        posts = con.execute(f"SELECT * EXCLUDE (created_utc, fetched_at), epoch(created_utc)::BIGINT AS made FROM read_parquet('{_quoted(folder)}/posts/*.parquet') ORDER BY post_id")
        yield from (("posts", row) for row in _dicts(posts))
        comments = con.execute(f"SELECT * EXCLUDE (created_utc, fetched_at), epoch(created_utc)::BIGINT AS made FROM read_parquet('{_quoted(folder)}/comments/*.parquet') ORDER BY post_id, comment_id")
        yield from (("comments", row) for row in _dicts(comments))
    finally:
        con.close()


def _dicts(result: Any) -> Iterator[dict[str, Any]]:
    names = [column[0] for column in result.description]
    while batch := result.fetchmany(4_096):
        yield from (dict(zip(names, row, strict=True)) for row in batch)


def _quoted(folder: Path) -> str:
    return str(folder).replace("'", "''")


def _post(row: dict[str, Any]) -> dict[str, Any]:
    text = "\n\n".join(part for part in (row["title"], row["body"]) if part)
    return {"id": row["post_id"], "conversation_id": row["post_id"], "text": text, "speaker": row["author_hash"] or _GONE, "reply-to": None,
            "timestamp": row["made"], "meta": {"score": row["score"], "depth": None, "type": row["type"]}, "vectors": []}


def _comment(row: dict[str, Any]) -> dict[str, Any]:
    return {"id": row["comment_id"], "conversation_id": row["post_id"], "text": row["body"], "speaker": row["author_hash"] or _GONE,
            "reply-to": row["parent_id"].partition("_")[2], "timestamp": row["made"],
            "meta": {"score": row["score"], "depth": row["depth"], "type": "comment"}, "vectors": []}


def _write(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, ensure_ascii=False, sort_keys=True, indent=0) + "\n", encoding="utf-8")
