"""Which records an import takes, and in what form."""

from datetime import UTC, datetime

import pytest

from kb.reddit.crawl.importer import import_dumps
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
    tombstones.add(tmp_path, "reddit", [("t3_gone", "named")])
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
