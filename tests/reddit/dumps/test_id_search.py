"""Records of dumps are found by their ids."""

import json
from pathlib import Path

from kb.reddit.dumps.files import Chunk
from kb.reddit.dumps.search import ById, IdIndex, write_index


def test_ids_of_any_length_and_kind(tmp_path: Path) -> None:
    write_index(
        ["t3_a", "t1_abcdefg", "t1_abcdefgh", "t3_abcdefghijk"], ["tree1"], tmp_path / "ids"
    )
    search = ById(IdIndex(tmp_path / "ids"))
    lines = [
        {"id": "a", "title": ""},
        {"id": "a", "body": ""},  # a comment of that id was not asked for
        {"id": "abcdefg", "body": ""},
        {"id": "abcdefgh", "body": ""},
        {"id": "abcdefghi", "body": ""},
        {"id": "abcdefghijk", "title": ""},
        {"id": "x", "media": {"id": "a"}, "title": ""},
        {"body": "", "link_id": "t3_tree1", "id": "reply"},
        {"id": "tree1", "title": "", "body": '"id":"a"'},
        {"id": 7, "title": ""},
    ]
    for separators in ((",", ":"), None):
        data = b"".join(json.dumps(one, separators=separators).encode() + b"\n" for one in lines)
        taken: list[object] = []
        chunk = Chunk(1 << 30, data, 0, len(data))
        found = search(chunk, lambda _, record, taken=taken: taken.append(record["id"]))
        assert taken == [*("a", "abcdefg", "abcdefgh", "abcdefghijk", "reply", "tree1")]
        assert (found.lines, found.bad_lines) == (len(lines), 0)
