"""Reddit as a ConvoKit corpus, out of a data root of any name;
that ConvoKit loads it is tested with Reddit's filter.
"""

import json
from pathlib import Path

import pytest

from kb.core.errors import DamagedData
from kb.export import convokit


def test_any_name_of_the_data_root_and_no_comments(tmp_path: Path, make_rows, run_at, fill) -> None:
    root = tmp_path / "a#b?c%41[d]*'e{f,g}"
    fill(root, "reddit/posts", make_rows("reddit/posts", 5), 2)
    assert convokit.export(run_at(root))["posts"] == 5
    fill(root, "reddit/comments", make_rows("reddit/comments", 4), 2)
    summary = convokit.export(run_at(root))
    lines = (root / "export" / "convokit" / "utterances.jsonl").read_text().splitlines()
    assert len({json.loads(line)["id"] for line in lines}) == 9 + summary["placeholders"]
    assert list(tmp_path.iterdir()) == [root]


def test_a_damaged_file_is_named(tmp_path: Path, make_rows, run_at, fill) -> None:
    fill(tmp_path, "reddit/posts", make_rows("reddit/posts", 5), 2)
    part = tmp_path / "clean" / "reddit" / "posts" / "part-00001.parquet"
    part.write_bytes(part.read_bytes()[:100])
    with pytest.raises(DamagedData, match=r"part-00001\.parquet can't be read") as caught:
        convokit.export(run_at(tmp_path))
    assert caught.value.hint == "run `kb reddit filter` again"
    assert not (tmp_path / "export" / "convokit").exists()
