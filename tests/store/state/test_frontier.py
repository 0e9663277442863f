"""Frontier, ledger and recorder: nothing answered is asked again, nothing asked is forgotten."""

import sqlite3

import pytest

from kb.artifacts import domain_binding
from kb.core.errors import DamagedData, OtherService
from kb.net import redact
from kb.store.rawlog import rawlog
from kb.store.state import frontier as module
from kb.store.state.frontier import Frontier


def open_frontier(root):
    return Frontier(root / "state" / "youtube.sqlite")


def test_items_are_taken_in_the_order_of_adding_and_once(tmp_path):
    frontier = open_frontier(tmp_path)
    assert frontier.add_keys("video", ["c", "a", ("b", {"channel": 1})]) == 3
    assert frontier.add_keys("video", ["a", "d"]) == 1
    assert [item.key for item in frontier.take("video", 2)] == ["c", "a"]
    assert [(item.key, item.payload) for item in frontier.take("video", 9)] == [
        ("b", {"channel": 1}),
        ("d", None),
    ]
    assert frontier.take("video") == []


def test_what_was_in_flight_is_asked_again_and_an_error_only_on_request(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add_keys("video", ["a", "b", "c"])
    frontier.take("video", 3)
    frontier.done("video", "a")
    frontier.error("video", "b", "HTTP 500")
    frontier.close()
    frontier = open_frontier(tmp_path)
    assert frontier.counts("video") == {"done": 1, "error": 1, "todo": 1}
    assert frontier.reopen("video", "error") == 1
    assert {item.key for item in frontier.take("video", 9)} == {"b", "c"}


def test_a_failed_transaction_changes_nothing(tmp_path):
    frontier = open_frontier(tmp_path)
    with pytest.raises(RuntimeError), frontier.transaction():
        frontier.add_keys("video", ["a"])
        frontier.set_cursor("page", "x")
        raise RuntimeError
    assert (frontier.counts("video"), frontier.cursor("page")) == ({}, None)


def test_the_ledger_is_committed_before_anything_else(tmp_path):
    frontier = open_frontier(tmp_path)
    row = frontier.spend("general", 1, "videos.list", "2026-11-20")
    other = sqlite3.connect(tmp_path / "state" / "youtube.sqlite")
    assert other.execute("SELECT bucket, units, outcome FROM ledger").fetchall() == [
        ("general", 1, None)
    ]
    frontier.outcome(row, "200")
    assert frontier.spent("general", "2026-11-20") == 1


def plan_of(frontier, sql, *values):
    return " ".join(row[3] for row in frontier._db.execute(f"EXPLAIN QUERY PLAN {sql}", values))


def test_adding_a_key_reads_no_other_item(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add_keys("video", ["c", "a", "b"])
    frontier.done("video", "b")
    # One step into the index, however many items there are, and no sorting afterwards.
    assert plan_of(frontier, module.LAST, "video") == (
        "SEARCH items USING COVERING INDEX items_by_order (kind=?)"
    )
    taking = "SELECT key FROM items WHERE kind = ? AND status = 'todo' ORDER BY seq LIMIT 1"
    assert "items_by_status (kind=? AND status=?)" in plan_of(frontier, taking, "video")
    assert "B-TREE" not in plan_of(frontier, taking, "video")
    assert frontier.add_keys("video", ["d"]) == 1
    assert [key for key, *_ in frontier.items("video")] == ["c", "a", "b", "d"]


def test_what_was_removed_is_in_no_byte_of_any_file(tmp_path):
    frontier = open_frontier(tmp_path)
    keys = [f"key{number:05d}" for number in range(5_000)]
    frontier.add_keys("video", [(key, {"channel": key}) for key in keys])
    frontier.done("video", *keys[::3])
    gone = keys[7::50]
    frontier.remove("video", gone)
    (tmp_path / "state" / "youtube.sqlite.v1.bak").write_text(gone[0])
    frontier.forget()
    found = b"".join(path.read_bytes() for path in (tmp_path / "state").iterdir())
    assert not [key for key in gone if key.encode() in found]
    assert sum(frontier.counts("video").values()) == len(keys) - len(gone)
    assert all(key.encode() in found for key in keys if key not in gone)


def test_replace_leaves_only_the_new_ones_in_their_order(tmp_path):
    frontier = open_frontier(tmp_path)
    frontier.add_keys("info", ["a", "b", "c"])
    frontier.done("info", "b")
    frontier.add_keys("video", ["a"])
    assert frontier.replace("info", iter(["z", ("b", {"post": "p"})])) == 2
    assert [(item.key, item.payload) for item in frontier.take("info", 9)] == [
        ("z", None),
        ("b", {"post": "p"}),
    ]
    assert frontier.counts("video") == {"todo": 1}


def test_a_state_that_cannot_be_read_says_what_to_do(tmp_path):
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "youtube.sqlite").write_bytes(b"no database " * 999)
    with pytest.raises(DamagedData) as error:
        open_frontier(tmp_path)
    assert "rebuilds it from the raw data" in error.value.hint


def test_a_root_keeps_to_its_services(tmp_path):
    domain_binding.bind_service(
        tmp_path, "reddit", host="http://127.0.0.1:5000", subreddit="minecraft"
    )
    domain_binding.bind_service(
        tmp_path, "reddit", host="http://127.0.0.1:6000", subreddit="minecraft"
    )
    # What was noted binds from the first answer on.
    segment = rawlog.Segment(rawlog.folder(tmp_path, "reddit", "listings"))
    segment.append(
        rawlog.encode(rawlog.Envelope("2026-11-20T12:00:00Z", rawlog.Request("new", {}), 200, {}))
    )
    segment.close()
    with pytest.raises(OtherService, match="subreddit minecraft, not terraria"):
        domain_binding.bind_service(tmp_path, "reddit", subreddit="terraria")
    with pytest.raises(OtherService, match=r"127\.0\.0\.1, not oauth\.reddit\.com"):
        domain_binding.bind_service(tmp_path, "reddit", host="https://oauth.reddit.com")


def test_a_reason_in_a_services_words_holds_no_secret(tmp_path):
    """A service may repeat the request, and the key in it, in its error."""
    redact.know(["a-very-secret-key"])
    frontier = open_frontier(tmp_path)
    frontier.add_keys("video", ["a", "b"])
    frontier.error("video", "a", "Bad request: /videos?id=a&key=a-very-secret-key was refused")
    frontier.skip("video", "b", "no a-very-secret-key")
    frontier.close()
    for path in (tmp_path / "state").iterdir():
        assert b"a-very-secret-key" not in path.read_bytes(), path
    redact.know([])
