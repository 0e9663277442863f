"""One dump becomes raw segments with the wanted records."""

import random
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from kb.core import engine
from kb.core.errors import LimitReached
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.parse.anonymize import load_key
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from tests.reddit.dumped import imported, imported_rows, post, run_in, write


@pytest.mark.parametrize("made", ["nan", "inf", -5, None, "soon", [1]])
def test_a_record_whose_date_cannot_be_read_is_left_to_the_filter(tmp_path, made):
    dump = write(tmp_path / "RS.zst", [post("odd", created_utc=made)])
    assert import_dumps(run_in(tmp_path), [dump])["crawled"] == 1
    assert (
        import_dumps(run_in(tmp_path), [dump], since=datetime(2020, 1, 1, tzinfo=UTC))["crawled"]
        == 1
    )


def test_emoji_right_to_left_nul_and_lone_surrogates(tmp_path):
    import_dumps(
        run_in(tmp_path),
        [write(tmp_path / "RS.zst", [post("odd", title="🗼 مرحبا a\0b \ud83d end")])],
    )
    assert [row["title"] for row in imported_rows(tmp_path)] == ["🗼 مرحبا a\ufffdb \ufffd end"]


def test_since_until_and_tombstones(tmp_path):
    tombstones.add_tombstones(tmp_path, "reddit", [("t3_gone", "named")])
    dump = write(
        tmp_path / "RS.zst",
        [
            post("early", created_utc=10),
            post("in", created_utc=20),
            post("gone", created_utc=21),
            post("late", created_utc=30),
        ],
    )
    import_dumps(
        run_in(tmp_path),
        [dump],
        since=datetime.fromtimestamp(20, UTC),
        until=datetime.fromtimestamp(30, UTC),
    )
    assert [data["id"] for _, data in imported(tmp_path)] == ["in"]


def lines(count: int) -> list[Any]:
    """Records of several subreddits; ours comes late, then in another spelling and
    without an id.
    """
    chance = random.Random(3)
    made: list[Any] = []
    for number in range(count):
        ours = number > count // 3 and chance.random() < 0.2
        fields: dict[str, Any] = {"subreddit": "gardening", "subreddit_id": "t5_other"}
        if ours:
            fields = {"subreddit": "Minecraft", "subreddit_id": "t5_2r05i"}
        if number == count // 2:
            fields = {"subreddit": "Minecraft"}  # from here on the id tells nothing
        if number > count // 2 and chance.random() < 0.02:
            fields = {"subreddit": "minecRAFT"}
        text = (
            "lone \ud800"
            if chance.random() < 0.01
            else chance.randbytes(chance.randrange(150)).hex()
        )
        made.append(post(f"k{number}", selftext=text, **fields))
        if chance.random() < 0.01:
            made.append(b'{"subreddit": "Minecraft", "id": "broken" ')
    return made


def files(root: Path) -> dict[str, bytes]:
    folder = rawlog.folder(root, "reddit", "dumps")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def dump(tmp_path: Path) -> Path:
    return write(tmp_path / "RS_2020-09.zst", lines(6_000), frames=3)


def test_a_file_is_read_by_one_process_however_many_there_are(
    dump: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers never cost more than one, and give the same segments of a file."""
    load_key(tmp_path / "one")
    shutil.copytree(tmp_path / "one", tmp_path / "many")  # the same key in both
    alone = import_dumps(run_in(tmp_path / "one"), [dump])
    monkeypatch.setattr(engine, "Processes", None)
    together = import_dumps(run_in(tmp_path / "many", workers=2), [dump])
    assert together == alone
    assert min(alone["crawled"] - 500, alone["bad_lines"] - 10) > 0
    assert files(tmp_path / "many") == files(tmp_path / "one")


def test_a_file_left_in_the_middle_goes_on_with_more_workers(dump: Path, tmp_path: Path) -> None:
    whole = import_dumps(run_in(tmp_path / "whole"), [dump])
    root = tmp_path / "parts"
    with pytest.raises(LimitReached):
        import_dumps(run_in(root, limit=150), [dump])
    rest = import_dumps(run_in(root, workers=2), [dump])
    assert rest["crawled"] == whole["crawled"] - 150
    assert [data["id"] for _, data in imported(root)] == [
        data["id"] for _, data in imported(tmp_path / "whole")
    ]
    assert import_dumps(run_in(root, workers=2), [dump])["crawled"] == 0
