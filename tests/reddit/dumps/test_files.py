"""Folders are searched for dumps."""

import gzip
from pathlib import Path

import pytest

from kb.core.errors import SettingError
from kb.core.progress import LineProgress
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps.files import find_dumps
from tests.reddit.dumped import blocks, joined, members, records, run_in, took, zstd


@pytest.mark.parametrize(
    "data",
    [b"plain text\n", b"[1, 2]\n", b"\xff\xfe{\0", b"PK\x03\x04", b"\x89PNG\r\n\x1a\n"],
)
def test_a_named_file_that_is_no_dump_is_wrong_usage(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.zst").write_bytes(data)
    with pytest.raises(SettingError, match=r"x\.zst is not a dump"):
        took(tmp_path / "data", [tmp_path / "x.zst"])
    with pytest.raises(SettingError, match="nowhere"):
        took(tmp_path / "data", [tmp_path / "nowhere"])
    assert not (tmp_path / "data").exists()


def test_folders_are_searched_and_other_files_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "dumps"
    data = joined(records(30))
    for name, made in {
        "comments/RC_2020-01.zst": zstd(data),
        "submissions/RS_2020-01.zst_blocks": blocks(data),
        "submissions/RS_2020-02": members(data),
        "mine.ndjson": data,
        "cut.zst": zstd(data)[:9],
        "SHA256SUMS": b"0123 *RC_2020-01.zst\n",
        "about.json": b'{"name": "Minecraft"}\n',
        "empty": b"",
        "backup.tar.gz": gzip.compress(b"ustar"),
        ".part": data,
    }.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(made)
    root = place / "data"  # the data root's own raw answers are no dumps
    run = run_in(root, progress=LineProgress())
    assert [file.name for file in find_dumps(run, [place]).files] == [
        "cut.zst",
        "mine.ndjson",
        "RC_2020-01.zst",
        "RS_2020-01.zst_blocks",
        "RS_2020-02",
    ]
    done = import_dumps(run, [place])
    assert (done["crawled"], done["foreign_files"], done["truncated_files"]) == (80, 4, 1)
    said = "skipped 4 files without posts: SHA256SUMS, about.json, backup.tar.gz, …"
    assert said in capsys.readouterr().err
    assert import_dumps(run, [place])["crawled"] == 0
    (tmp_path / "none").mkdir()
    with pytest.raises(SettingError, match="contains no dumps"):
        find_dumps(run, [tmp_path / "none"])
