"""Whole lines of any dump, with damage counted."""

import pytest

from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps import files
from kb.reddit.dumps.files import DEEPEST
from tests.reddit.dumped import imported, post, run_in, write


def test_objects_that_are_broken_inside_count_in_a_file_of_the_subreddit(tmp_path):
    dump = write(tmp_path / "RS.zst", [post("aaa"), b'{"id": broken}', b"garbage", post("bbb")])
    assert import_dumps(run_in(tmp_path), [dump])["bad_lines"] == 2


@pytest.mark.parametrize("innermost", [b"", b"0"])
@pytest.mark.parametrize("depth", [199, 200, 300, 3_000, 200_000])
def test_a_line_nested_without_end_is_damaged(tmp_path, depth, innermost):
    lists = b"[" * depth + innermost + b"]" * depth
    record = b'{"id": "q", "subreddit": "Minecraft", "title": "t", "x": ' + lists + b"}"
    summary = import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", [record, post("good")])])
    # The record itself is one level.
    bad = int(1 + depth > DEEPEST)
    assert (summary["crawled"], summary["bad_lines"]) == (2 - bad, bad)


@pytest.mark.parametrize("last", [False, True])
def test_a_line_without_end_is_not_held_and_counts_as_damaged(tmp_path, monkeypatch, last):
    """One of 1.8 GB swells from a small file."""
    monkeypatch.setattr(files, "LONGEST", 300_000)
    long = b'{"subreddit": "Minecraft", "id": "' + b"x" * 40_000_000
    lines = [post("a"), long, *([] if last else [post("b")])]
    dump = write(tmp_path / "RS.zst", lines, frames=len(lines))
    held = max_held(files.chunks(dump, files.ReadProgress()))
    assert held < 5_000_000
    assert max(len(piece) for piece in files.pieces(dump, files.ReadProgress())) < 5_000_000
    done = import_dumps(run_in(tmp_path), [dump])
    assert (done["lines"], done["bad_lines"]) == (len(lines), 1)
    assert [data["id"] for _, data in imported(tmp_path)] == ["a"] + ["b"] * (not last)


def max_held(chunks):
    return max(len(chunk.data) for chunk in chunks)
