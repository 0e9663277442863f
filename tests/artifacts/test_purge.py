"""The frame of every purge: its list of keys, and its plan."""

from pathlib import Path

import pytest

from kb.artifacts import purge
from kb.core.errors import DamagedData
from kb.core.sources import SOURCES
from kb.store.layout import Layout
from tests.filters.made import MONDAY, listing, put, run_at, video

DAMAGE = (b"", b"\xff\xfe", b"null", b"[]", b'{"a": 1}', b"[" * 100_000)


@pytest.mark.parametrize("data", DAMAGE, ids=["empty", "binary", "null", "list", "other", "deep"])
def test_a_damaged_list_of_keys_is_named_with_what_to_do(tmp_path: Path, data: bytes) -> None:
    path = Layout(tmp_path).purge("wiki")
    path.parent.mkdir()
    path.write_bytes(data)
    with pytest.raises(DamagedData, match=f"{path} can't be read: ") as error:
        purge.unfinished(tmp_path, "wiki")
    assert error.value.hint == "delete it, then run `kb purge wiki` again"


def test_a_dry_run_includes_what_an_interrupted_purge_left(tmp_path: Path) -> None:
    put(tmp_path, "videos", (MONDAY, {"id": "a,b,c"}, listing(video("a"), video("b"))))
    path = Layout(tmp_path).purge("youtube")
    path.parent.mkdir(exist_ok=True)
    path.write_text('{"a": "named"}')
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with purge.dry_purge(run_at(tmp_path), SOURCES["youtube"].purge_rules(), None) as dry:
        assert dry.keys == {"a": "named", "c": "vanished"}
        (line,) = purge.answers(dry)
    assert (line.folder, line.count) == ("raw/youtube/videos", 1)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before
