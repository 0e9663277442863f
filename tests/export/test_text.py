"""`--format text`: documents of the three sources, chunks, contacts, and who reads the files."""

import json
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tokenizers import Tokenizer, models, pre_tokenizers, processors, trainers

from kb.artifacts import freshness
from kb.artifacts.makers import make_artifact
from kb.core.errors import FatalError, SettingError
from kb.core.sources import SOURCES
from kb.export import text
from kb.export.contacts import replaced
from kb.export.text import TextOptions, TextPiece
from kb.registry import SOURCES as CLASSES
from kb.schema.tables import table
from kb.store.tables.shard_writer import write_table
from kb.youtube.text import paragraphs
from tests.inprocess import Here
from tests.recipes import export
from tests.release.made import build

DAY = datetime(2026, 3, 1, tzinfo=UTC)


def lines(root: Path, source: str) -> list[dict[str, Any]]:
    path = root / f"export/text/{source}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def told(tmp_path: Path, make_rows: Any, run_at: Any, fill: Any) -> Any:
    """told(comments) → the text of one thread with these comments."""

    def make(comments: list[dict[str, Any]], **post: Any) -> str:
        own = {
            "title": "Why does\nit rain?",
            "body": "It *always* does.\n\nHelp",
            "fetched_at": DAY,
        }
        values = {**own, "post_id": "p1", "fetched_at": DAY, **post}
        one = {name: [value] for name, value in values.items()}
        posts = make_rows("reddit/posts", 1, **one)
        columns = {name: [one[name] for one in comments] for name in comments[0]}
        columns["post_id"] = ["p1"] * len(comments)
        rows = make_rows("reddit/comments", len(comments), **columns)
        fill(tmp_path, "reddit/posts", posts, 1)
        fill(tmp_path, "reddit/comments", rows, 1)
        export(run_at(tmp_path), "reddit", "text")
        (line,) = lines(tmp_path, "reddit")
        assert line["metadata"]["url"] == "https://www.reddit.com/r/Minecraft/comments/p1/"
        assert (line["id"], line["source"], line["added"]) == (
            "p1",
            "reddit",
            "2026-03-01T00:00:00Z",
        )
        return str(line["text"])

    return make


def comment(key: str, parent: str, depth: int | None, body: str, minute: int) -> dict[str, Any]:
    return {
        "comment_id": key,
        "parent_id": parent,
        "depth": depth,
        "body": body,
        "created_utc": DAY.replace(minute=minute),
    }


def test_a_thread_is_a_nested_list_in_which_what_is_gone_is_marked(told: Any) -> None:
    comments = [
        comment("c2", "t1_c1", 1, "First answer\n\n> with a quote", 2),
        comment("c1", "t3_p1", 0, "Because of clouds", 1),
        comment("c4", "t1_gone", 2, "To something deleted", 4),
        comment("c3", "t3_p1", 0, "I *know*", 3),
        comment("c5", "t1_c2", 2, "Deeper", 5),
    ]
    assert told(comments, poll_options=["Yes", "No"]) == (
        "# Why does it rain?\n\nIt *always* does.\n\nHelp\n\n- Yes\n- No\n\n- Because of clouds\n\n"
        "  - First answer\n\n    > with a quote\n\n    - Deeper\n\n- I *know*\n\n"
        "- […]\n\n  - [deleted]\n\n    - To something deleted"
    )


def test_a_transcript_has_a_time_at_each_paragraph() -> None:
    starts = np.array([0.0, 2.0, 9.0, 61.0, 3661.5])
    said = ["so we", "build\na house", "after a pause", "[Music]", "  the end"]
    found = paragraphs(starts, np.full(5, 2.0), np.array([2, 3, 3, 1, 2]), said)
    assert [one.text for one in found] == [
        "[00:00] so we build a house",
        "[00:09] after a pause",
        "[01:01] [Music]",
        "[61:01] the end",
    ]
    # Without a long pause at the longest one: here behind the 80th word, of at most 120.
    starts = np.arange(40.0) * 2 + (np.arange(40) >= 20)
    words = ["one two three four"] * 40
    found = paragraphs(starts, np.full(40, 2.0), np.full(40, 4), words)
    assert [(one.text[:7], len(one.text.split()) - 1) for one in found] == [
        ("[00:00]", 80),
        ("[00:41]", 80),
    ]


def test_videos_pages_and_threads_are_read_as_data_sets(tmp_path: Path, run_at: Any) -> None:
    """By the `datasets` library, and by the fields that datatrove's JsonlReader and Dolma read."""
    import datasets

    root = build(tmp_path / "data")
    videos = pq.read_table(root / "clean/youtube/videos/part-00000.parquet")["video_id"]
    cue = {"start_s": 0.0, "duration_s": 2.0, "text": "now we build"}
    told = {"kind": "asr", "language": "en", "cues": [cue], "word_times": None}
    told |= {"read_from": "watch_page", "fetched_at": DAY}
    rows = [{"video_id": key, **told} for key in videos.to_pylist()]
    path = root / "clean/youtube/transcripts/part-00000.parquet"
    kinds = table("youtube/transcripts").arrow()
    write_table(path, pa.Table.from_pylist(rows, kinds), "youtube/transcripts")
    run = run_at(root)
    for source, main in (("youtube", "videos"), ("wiki", "pages"), ("reddit", "posts")):
        made = export(run, source, "text")
        path = root / f"export/text/{source}.jsonl"
        read = datasets.load_dataset(
            "json", data_files=str(path), split="train", cache_dir=str(tmp_path / "cache")
        )
        assert made["documents"] == len(read) == len({row["id"] for row in read})
        for line in lines(root, source):
            assert set(line) == {"id", "text", "source", "added", "created", "metadata"}
            assert isinstance(line["id"], str)
            assert line["text"].startswith(f"# {line['metadata']['title']}")
            assert {"title", "url", "license"} <= set(line["metadata"])
        before = path.read_bytes()
        export(run, source, "text")
        assert path.read_bytes() == before
        assert freshness.reasons(run, f"export/text/{source}.jsonl") == []
        assert main in table(f"{source}/{main}").name


def test_nothing_to_export_is_an_empty_file(tmp_path: Path, run_at: Any) -> None:
    with pytest.raises(FatalError, match="nothing to export"):
        export(run_at(tmp_path), "reddit", "text")
    for name in ("reddit/posts", "reddit/comments"):
        empty = table(name).arrow().empty_table()
        write_table(tmp_path / f"clean/{name}/part-00000.parquet", empty, name)
    made = export(run_at(tmp_path), "reddit", "text")
    assert (made["documents"], (tmp_path / "export/text/reddit.jsonl").read_bytes()) == (0, b"")


@pytest.mark.parametrize("name", [f"{s}/{t}" for s in SOURCES for t in SOURCES[s].textual])
def test_without_one_of_the_tables_of_its_texts_nothing_is_written(
    name: str, tmp_path: Path, make_rows: Any, run_at: Any, fill: Any
) -> None:
    source = name.partition("/")[0]
    for other in {f"{source}/{short}" for short in SOURCES[source].textual} - {name}:
        fill(tmp_path / "data", other, make_rows(other, 1), 1)
    with pytest.raises(FatalError, match=f"has no content of {name}$"):
        CLASSES[source].writers()["text"](run_at(tmp_path / "data"), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_chunks_begin_at_headings_and_hold_no_more_than_asked(tmp_path: Path) -> None:
    pieces = [
        TextPiece("lead " * 20),
        TextPiece("## A", begins=True, level=2),
        TextPiece("alpha " * 20),
        TextPiece("### B", begins=True, level=3),
        TextPiece("beta " * 300),
        TextPiece("## C", begins=True, level=2),
        TextPiece("| h | i |\n| --- | --- |\n" + "| gamma | delta |\n" * 60),
    ]
    trained = Tokenizer(models.WordLevel(unk_token="?"))
    trained.pre_tokenizer = pre_tokenizers.Whitespace()
    trained.train_from_iterator(["a"], trainers.WordLevelTrainer(special_tokens=["?"]))
    trained.save(str(tmp_path / "tokenizer.json"))
    for options, count in (
        (TextOptions(100), lambda one: len(one.split()) * 1.3),
        (
            TextOptions(100, str(tmp_path / "tokenizer.json")),
            lambda one: len(trained.encode(one).ids),
        ),
    ):
        chunks = list(text._chunks("# T", pieces, options))
        assert all(count(one) <= 100 for one in chunks)
        assert all(one.startswith("# T\n\n") for one in chunks)
        assert any(one.startswith("# T\n\n## A\n\n### B\n\nbeta") for one in chunks)
        assert all("\n| --- | --- |\n" in one for one in chunks if "gamma" in one)
        assert not any("beta" in one and "gamma" in one for one in chunks)
        told = Counter(word for one in chunks for word in one.split())
        assert [told[w] for w in ("lead", "alpha", "beta", "gamma")] == [20, 20, 300, 60]
    assert len(list(text._chunks("# T", pieces[:4], TextOptions(200)))) == 1


LONG = {
    "japanese": "窯を開けると釉薬が青く光っていた。みんなで静かに眺めました。" * 40,
    "thai": "เตาเผาร้อนมากวันนี้เราเผาเครื่องปั้นดินเผา" * 40,
    "khmer": "ខ្ញុំចូលចិត្តដីឥដ្ឋណាស់" * 60,
    "base64": "R2xhemUgaXMgYmx1ZSBhbmQgY2xheSBpcyByZWQu" * 60,
    "an address": "https://kiln.example/a?" + "&".join(f"shelf{n}={n * 7919}" for n in range(200)),
    "emoji": "👩‍🚀🏺" * 300,
    "mixed": "The kiln 窯は開いた。" * 80,
    "words": "The glaze is done. Open the kiln now! " * 90,
}


@pytest.mark.parametrize("known", [False, True], ids=["estimated", "tokenizer"])
@pytest.mark.parametrize("said", LONG.values(), ids=LONG)
def test_a_text_without_spaces_is_cut_and_nothing_of_it_is_lost(
    said: str, known: bool, tmp_path: Path
) -> None:
    trained = Tokenizer(models.BPE(byte_fallback=True))
    trained.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    special = ["[A]", "[Z]"]
    trained.train_from_iterator(
        LONG.values(),
        trainers.BpeTrainer(vocab_size=400, initial_alphabet=alphabet, special_tokens=special),
    )
    ends = [(name, trained.token_to_id(name)) for name in special]
    trained.post_processor = processors.TemplateProcessing("[A] $A [Z]", None, ends)
    trained.save(str(tmp_path / "tokenizer.json"))
    options = TextOptions(64, str(tmp_path / "tokenizer.json") if known else "")
    for title in ("T", said[:300]):
        pieces = [TextPiece("Before."), TextPiece(said, begins=True)]
        chunks = list(text._chunks(f"# {title}", pieces, options))
        body = [one.partition("\n\n")[2] for one in chunks]
        begun = "" if chunks[0].startswith(f"# {title}\n\n") else title
        assert "".join("".join(body).split()) == "".join(f"{begun}Before.{said}".split())
        for one in chunks:
            size = len(trained.encode(one).ids) if known else text.count(one, options)
            assert size <= 64
            assert not text._is_mark(one.split("\n\n")[-1][0])
    if (said.isascii() and " " in said) or "。" in said:
        ends = [one for one in body[2:-1] if one[-1] in ".!。"]
        assert len(ends) >= 0.9 * len(body[2:-1])


def test_an_estimate_suits_the_script() -> None:
    for said, least, most in (
        ("so we build a house here", 6, 9),
        ("窯を開けると釉薬が青い", 11, 16),
        ("เตาเผาร้อนมาก", 12, 18),
        ("R2xhemUgaXMgYmx1ZSBhbmQgY2xheSBpcyByZWQu", 20, 40),
        ("창문을 열고 안을 본다", 5, 8),
    ):
        assert least <= text.count(said, TextOptions(64)) <= most, said


def test_options_of_chunks_are_kept_and_asked_for_with_text_only(
    tmp_path: Path, run_at: Any, here: Here
) -> None:
    root = build(tmp_path / "data", sources=("reddit",))
    run = run_at(root)
    made = export(run, "reddit", "text", chunk_tokens=40)
    assert made["tokens"] == "words × 1.3, as are signs of scripts without spaces"
    before = lines(root, "reddit-chunks")
    assert {"document", "chunk", "chunks"} <= set(before[0]["metadata"])
    make_artifact(run, "export/text/reddit-chunks.jsonl")  # as a purge does
    assert lines(root, "reddit-chunks") == before
    with pytest.raises(SettingError, match="can't be read"):
        export(run, "reddit", "text", chunk_tokens=40, tokenizer=str(root / "none"))
    for arguments, words in (
        (("--chunk-tokens", "100"), "--chunk-tokens is for --format text"),
        (("--format", "text", "--tokenizer", "x"), "--tokenizer counts the tokens of chunks"),
    ):
        done = here("reddit", "export", "--data", str(root), *arguments)
        assert (done.code, words in done.err) == (2, True), done.err


@pytest.mark.parametrize("source", ["reddit", "wiki"])
def test_documents_and_their_chunks_are_files_of_their_own(
    tmp_path: Path, run_at: Any, source: str
) -> None:
    run = run_at(root := build(tmp_path / "data", sources=(source,)))
    plain, chunked = (f"export/text/{source}{end}" for end in (".jsonl", "-chunks.jsonl"))
    assert {name for name in freshness.graph(run, ["text"]) if name.startswith("export/")} == {
        plain
    }
    export(run, source, "text")
    documents = lines(root, source)
    export(run, source, "text", chunk_tokens=40)
    assert lines(root, source) == documents
    assert {one["metadata"]["document"] for one in lines(root, f"{source}-chunks")} == {
        one["id"] for one in documents
    }
    for name in (plain, chunked):  # a build looks after both, each with its own options
        assert name in freshness.graph(run, ["text"])
        assert freshness.reasons(run, name) == []
        before = (root / name).read_bytes()
        (root / name).unlink()
        make_artifact(run, name)
        assert (root / name).read_bytes() == before


STAYS = """seed -4172144997902289642, Seed: 146008555100680
/tp @s 12345 70 12345 and /tp 1204 64 -2210
at -1203 -59 2333, X: 10032 Y: 64 Z: -29991, (10234, 70, -23423)
12000 72 44000 is where I live
version 1.16.210.54, Beta 1.2.0.81, v1.19.83.01, 1.20.4 and 24w45a; Bedrock 26.10.20.1
2024-11-05 12:30:45, 2024-11-05 1230, 05.11.2024 12:30, 2009-05-17 to 2011-11-18, 2010-2024
1.000.000.000 blocks, 100 000 000 000, 2 147 483 647; 100 200 300 400; 64-128-256; 1000-2000-3000
ISBN 978-3-16-148410-0, 123e4567-e89b-12d3-a456-426614174000
@e[type=zombie,limit=1], 10:20:30:40, std::vector, minecraft:stone, 16 x 16 x 384
https://example.org/2023/10/05-123-4567"""
GOES = {
    "emails": ("jane.doe+x@mail.example.co.uk", "steve@example.com"),
    "ip_addresses": (
        *("123.45.67.89", "192.168.1.20", "our server ip is 1.2.3.4"),
        *("2001:db8:85a3::8a2e:370:7334", "fe80::1ff:fe23:4567:890a"),
    ),
    "phones": (
        *("+49 171 1234567", "+1 (555) 123-4567", "+15551234567", "(555) 123-4567"),
        *("555-123-4567", "555.123.4567", "call 555 123 4567", "1-800-555-0199", "0171-1234567"),
        *("06 12 34 56 78", "phone: 123 456 789", "+44 20 7946 0958"),
    ),
}


def test_contacts_are_replaced_and_nothing_that_looks_like_one() -> None:
    counts: Counter[str] = Counter()
    assert replaced(STAYS, counts) == STAYS
    assert not counts.total()
    for kind, texts in GOES.items():
        for one in texts:
            counts.clear()
            found = replaced(f"Well, {one} it is", counts)
            assert counts == {kind: 1}, one
            assert not any(map(str.isdigit, found)), found


def test_contacts_stay_where_they_are_asked_to(told: Any, run_at: Any, tmp_path: Path) -> None:
    comments = [comment("c1", "t3_p1", 0, "Write to steve@example.com", 1)]
    assert "Write to [email]" in told(comments)
    made = export(run_at(tmp_path), "reddit", "text", keep_contacts=True)
    assert "contacts" not in made
    assert "Write to steve@example.com" in lines(tmp_path, "reddit")[0]["text"]
