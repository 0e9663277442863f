"""Reddit as a ConvoKit corpus (convokit.cornell.edu, corpus format): a folder that
`Corpus(filename=…)` loads.

    utterances.jsonl     one post or comment a line: id, conversation_id, text, speaker, reply-to,
                         timestamp, meta
    speakers.json        keyed hashes of authors
    conversations.json   posts with their figures
    corpus.json          what the corpus is
    index.json           types of the meta fields

ConvoKit walks a conversation only when every utterance's parent is there. For a comment that was
filtered out or deleted an empty utterance stands in, with `meta.placeholder` true, a direct reply
to the post. Who wrote it is not known, nor whether two are of one author: each has a speaker of its
own, `unknown-<id>`, and so has what a deleted account wrote.

Holds titles and bodies: it stays under export/ on the user's own disk and is never released.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.summary import Summary
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

_GONE = "unknown-"  # and the id: ConvoKit needs a speaker for every utterance
_TEXT, _NUMBER, _FLAG = ["<class 'str'>"], ["<class 'int'>"], ["<class 'bool'>"]
_INDEX = {
    "utterances-index": {"score": _NUMBER, "depth": _NUMBER, "type": _TEXT, "placeholder": _FLAG},
    "speakers-index": {},
    "overall-index": {"name": _TEXT},
    "conversations-index": {
        "title": _TEXT,
        "type": _TEXT,
        "num_comments": _NUMBER,
        "score": _NUMBER,
    },
    "vectors": [],
    "version": 1,
}
_POSTS = """
    SELECT post_id, title, body, type, score, num_comments, author_hash,
        epoch(created_utc)::BIGINT AS made
    FROM {posts} ORDER BY post_id"""
# A stand-in is as old as its first reply: nothing else is known of it.
_COMMENTS = """
    WITH kept AS (
        SELECT comment_id, post_id, parent_id[4:] AS parent, body, score, depth, author_hash,
            epoch(created_utc)::BIGINT AS made
        FROM {comments}
    ), gone AS (
        SELECT parent, post_id, min(made) AS made
        FROM kept ANTI JOIN kept AS other ON kept.parent = other.comment_id
        WHERE parent != post_id GROUP BY ALL
    )
    SELECT *, false AS placeholder FROM kept UNION ALL BY NAME
    SELECT parent AS comment_id, post_id, post_id AS parent, '' AS body, made, true AS placeholder
    FROM gone
    ORDER BY post_id, comment_id"""


def export(run: Run) -> Summary:
    """clean/reddit → export/convokit/. Raises FatalError without clean rows, DamagedData, DiskFull.

    The same rows give the same bytes.
    """
    at = Layout(run.root)
    posts = manifest.rows(run.root, "reddit/posts")
    comments = manifest.rows(run.root, "reddit/comments")
    if not posts:
        raise FatalError(
            "nothing to export: clean/reddit has no posts", hint="run `kb reddit filter` first"
        )
    speakers: set[str] = set()
    counts = {"posts": 0, "comments": 0, "placeholders": 0}
    with (
        database.connect(run.root) as con,
        replacing_folder(at.export("convokit")) as fresh,
    ):
        with (
            (fresh / "utterances.jsonl").open("w", encoding="utf-8") as file,
            (fresh / "conversations.json").open("w", encoding="utf-8") as about,
        ):
            about.write("{")
            for row in _rows(con, _POSTS.format(posts=scan(posts)), posts):
                _put(file, _post(row), speakers)
                meta = {name: row[name] for name in ("title", "type", "num_comments", "score")}
                entry = json.dumps({"meta": meta, "vectors": []}, ensure_ascii=False)
                about.write(
                    f"{',' if counts['posts'] else ''}\n{json.dumps(row['post_id'])}: {entry}"
                )
                counts["posts"] += 1
            about.write("\n}\n")
            for row in (
                _rows(con, _COMMENTS.format(comments=scan(comments)), comments) if comments else ()
            ):
                _put(file, _comment(row), speakers)
                counts["placeholders" if row["placeholder"] else "comments"] += 1
        _write(
            fresh / "speakers.json",
            {name: {"meta": {}, "vectors": []} for name in sorted(speakers)},
        )
        _write(fresh / "corpus.json", {"name": f"{run.profile.name}-reddit"})
        _write(fresh / "index.json", _INDEX)
    return Summary(
        **counts,
        path=str(at.export("convokit")),
    )


def _rows(
    con: duckdb.DuckDBPyConnection, query: str, files: list[Path]
) -> Iterator[dict[str, Any]]:
    """The rows of a query over these files; memory is bounded by a batch, DuckDB sorts on disk."""
    with reading(files):
        parquet.check(*files)
        result = con.execute(query)
        names = [column[0] for column in result.description]
        while batch := result.fetchmany(4_096):
            yield from (dict(zip(names, row, strict=True)) for row in batch)


def _post(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": row["post_id"],
        "conversation_id": row["post_id"],
        "text": "\n\n".join(part for part in (row["title"], row["body"]) if part),
        "speaker": row["author_hash"] or f"{_GONE}{row['post_id']}",
        "reply-to": None,
        "timestamp": row["made"],
        "meta": {"score": row["score"], "depth": None, "type": row["type"], "placeholder": False},
        "vectors": [],
    }


def _comment(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": row["comment_id"],
        "conversation_id": row["post_id"],
        "text": row["body"],
        "speaker": row["author_hash"] or f"{_GONE}{row['comment_id']}",
        "reply-to": row["parent"],
        "timestamp": row["made"],
        "meta": {
            "score": row["score"],
            "depth": row["depth"],
            "type": "comment",
            "placeholder": row["placeholder"],
        },
        "vectors": [],
    }


def _put(file: Any, utterance: dict[str, Any], speakers: set[str]) -> None:
    file.write(json.dumps(utterance, ensure_ascii=False, sort_keys=True) + "\n")
    speakers.add(utterance["speaker"])


def _write(path: Path, value: Any) -> None:
    path.write_text(
        json.dumps(value, ensure_ascii=False, sort_keys=True, indent=0) + "\n", encoding="utf-8"
    )
