"""What a reconstruction asks for and adds to its tables."""

import html
import json
import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb.core.errors import LimitReached, SettingError
from kb.reddit.restore.reconstruct import rebuild
from kb.sandbox.invented_ids import PEOPLE
from kb.store.state import tombstones
from tests.reddit.dumped import post, write
from tests.reddit.restore.test_reconstruct import (
    missing,
    plain,
    released,
)
from tests.reddit.work import NOW, Work, rows, texts


def test_mine_dojos_list_brings_whole_trees(whole: Work, far: Work) -> None:
    far.rebuild(whole.root / "export" / "minedojo" / "reddit.json")
    assert plain(rows(far.place / "out" / "posts")) == plain(
        whole.table("clean", "reddit", "posts")
    )
    assert plain(rows(far.place / "out" / "comments")) == plain(
        whole.table("clean", "reddit", "comments")
    )
    assert max(row["depth"] for row in rows(far.place / "out" / "comments")) == 39
    missing = {
        row["key"]: row["reason"]
        for row in pq.read_table(far.place / "out" / "missing.parquet").to_pylist()
    }
    assert set(missing.values()) == {"deleted", "removed"}


def test_a_published_post_that_is_gone_is_missing(work: Work) -> None:
    ids = work.place / "reddit.json"
    posts = list(work.world.posts)
    ids.write_text(json.dumps([{"id": posts[0], "type": "text"}, {"id": "zzzzz", "type": "image"}]))
    assert work.rebuild(ids)["posts"] == 1
    posts_missing = {key: why for key, why in missing(work).items() if key.startswith("t3_")}
    assert posts_missing == {"t3_zzzzz": "missing"}


def test_an_answered_reconstruction_asks_nothing_and_again_asks_anew(
    whole: Work, far: Work
) -> None:
    first = far.rebuild(released(whole))
    since = len(far.sandbox.ledger)
    assert far.rebuild(released(whole)) == {**first, "requests": 0}
    assert len(far.sandbox.ledger) == since
    assert far.rebuild(released(whole), again=True)["requests"] == first["requests"]
    assert [
        path.name for path in (far.place / "out").iterdir() if path.name.startswith(".work")
    ] == []


def test_killed_in_the_middle_only_what_was_in_flight_is_asked_again(
    whole: Work, far: Work
) -> None:
    since = len(far.sandbox.ledger)
    held = far.sandbox.faults.add("api/info", after=5, hold=True)
    child = far.job().start(
        "reddit", "reconstruct", "--ids", str(released(whole)), "--out", str(far.place / "out")
    )
    assert held.arrived.wait(60)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    held.release()
    assert not (far.place / "out" / "posts").exists()
    far.rebuild(released(whole))
    asked = Counter(
        seen.args["id"] for seen in far.sandbox.ledger.requests("api/info", since=since)
    )
    assert sorted(asked.values()) == [1] * (len(asked) - 1) + [2]
    assert plain(rows(far.place / "out" / "comments")) == plain(
        whole.table("clean", "reddit", "comments")
    )


def test_a_request_that_fails_is_counted_and_tried_by_the_next_run(whole: Work, far: Work) -> None:
    """It fails for one id: the hundred that are asked for with it are read."""
    bad = whole.table("clean", "reddit", "posts")[-1]["post_id"]
    fault = far.sandbox.faults.add(f"api/info.*t3_{bad}", status=500, times=None)
    summary = far.rebuild(released(whole))
    far.sandbox.faults.remove(fault)
    assert (summary["failed"], summary["missing"]) == (1, 0)
    missing = pq.read_table(far.place / "out" / "missing.parquet").to_pylist()
    assert [(row["key"], row["reason"]) for row in missing] == [(f"t3_{bad}", "failed")]
    since = len(far.sandbox.ledger)
    assert far.rebuild(released(whole))["missing"] == 0
    assert len(far.sandbox.ledger.requests("api/info", since=since)) == 1


AT = int(datetime.fromisoformat(NOW).timestamp())
KEYS = ("REDDIT_CLIENT_ID", "REDDIT_CLIENT_SECRET", "KB_REDDIT_ENDPOINT", "KB_CONTACT")


def archived(things: Iterable[dict[str, Any]], at: int = AT) -> Iterator[dict[str, Any]]:
    """Records as an archive keeps what the API showed at a moment."""
    for shown in things:
        record = {**shown, "retrieved_on": at}
        for name in ("title", "selftext", "body"):
            if isinstance(record.get(name), str):
                record[name] = html.escape(record[name], quote=False)
        if "body" in record:
            record["replies"] = ""
        yield record


def other(number: int) -> dict[str, Any]:
    """Of another subreddit, whose nested ids are nobody's own."""
    media = {"id": f"y{number}", "name": "x"}
    return {**post(f"zz{number}"), "subreddit": "gardening", "subreddit_id": "t5_x", "media": media}


@pytest.fixture(scope="session")
def month(whole: Work, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two dumps of the moment of the crawl, all subreddits mixed, in no order, in both spacings."""
    place, draw = tmp_path_factory.mktemp("month"), random.Random(0)
    paths = []
    for name, prefix, keys in (
        ("RS_2026-11.zst", "t3_", list(whole.world.posts)),
        ("RC_2026-11.zst", "t1_", list(whole.world.comments)),
    ):
        shown = (whole.world.shown(f"{prefix}{key}") for key in keys)
        records = [*archived(one for one in shown if one is not None), *map(other, range(200))]
        draw.shuffle(records)
        lines = [
            json.dumps(one, separators=(",", ":") if number % 2 else None).encode()
            for number, one in enumerate(records)
        ]
        paths.append(write(place / name, lines, frames=3))
    return paths


def from_dumps(work: Work, ids: Path, files: list[Path], **options: Any) -> dict[str, Any]:
    return rebuild(work.run(**options), ids, work.place / "out", dumps=files)


@pytest.mark.parametrize("named", [False, True], ids=["any subreddit", "the release's own"])
def test_rows_are_those_of_the_api_at_the_same_moment(
    whole: Work, far: Work, month: list[Path], named: bool
) -> None:
    since = len(far.sandbox.ledger)
    folder = far.place / "release"
    shutil.copytree(released(whole), folder)
    if named:
        (folder / "profile.toml").write_text('[reddit]\nsubreddit = "minecraft"\n')
    words = ["--ids", str(folder), "--out", str(far.place / "out"), "--dumps"]
    job = far.job()
    for name in KEYS:
        job.env.pop(name)
    summary = job.done("reddit", "reconstruct", *words, *map(str, month))
    assert len(far.sandbox.ledger) == since
    for name in ("posts", "comments"):
        found = rows(far.place / "out" / name)
        assert plain(found) == plain(whole.table("clean", "reddit", name))
        assert {row["score_source"] for row in found} == {"dump"}
        assert {row["fetched_at"].isoformat() for row in found} == {"2026-11-20T12:00:00+00:00"}
    assert missing(far) == {}
    assert (summary["requests"], summary["missing"], summary["bad_lines"]) == (0, 0, 0)
    for path, text in texts(far.place).items():
        assert not [name for name in PEOPLE if name in text], path


def test_without_a_key_the_way_with_dumps_is_named(whole: Work, far: Work) -> None:
    job = far.job()
    job.env.pop("REDDIT_CLIENT_ID")
    line = job.stopped("reddit", "reconstruct", "--ids", str(released(whole)), code=2)
    assert "REDDIT_CLIENT_ID" in line
    assert "--dumps" in line


def test_what_the_dumps_lack_is_named_and_later_added(
    whole: Work, far: Work, month: list[Path]
) -> None:
    summary = from_dumps(far, released(whole), month[:1])
    comments = whole.table("clean", "reddit", "comments")
    assert set(missing(far).values()) == {"not in these dumps"}
    assert summary["missing"] == len(missing(far)) == len(comments)
    from_dumps(far, released(whole), month[1:])
    assert missing(far) == {}
    assert plain(rows(far.place / "out" / "comments")) == plain(comments)
    assert from_dumps(far, released(whole), month[1:])["lines"] > 0  # read before, told again


def test_whole_trees_of_mine_dojos_list(whole: Work, far: Work, month: list[Path]) -> None:
    from_dumps(far, whole.root / "export" / "minedojo" / "reddit.json", month)
    found = {row["comment_id"] for row in rows(far.place / "out" / "comments")}
    assert found == {row["comment_id"] for row in whole.table("clean", "reddit", "comments")}


def live(work: Work, number: int) -> list[str]:
    """Posts with everything that a row needs."""
    return [key for key, row in work.world.posts.items() if row.get("score")][:number]


def dump(work: Work, name: str, keys: list[str], at: int | None = AT, **fields: Any) -> Path:
    """A dump of these posts; `at` is when they were read, None: it does not say."""
    records = [{**one, **fields} for one in archived(work.world.posts[key] for key in keys)]
    for record in records:
        record["retrieved_on"] = at
    return write(work.place / f"{name}.zst", records)


@pytest.mark.parametrize("word", ["[removed]", "[deleted]"])
def test_an_older_dump_undoes_no_removal_of_a_later_source(work: Work, word: str) -> None:
    first, second, third = live(work, 3)
    ids = work.place / "ids.txt"
    ids.write_text("\n".join(f"t3_{key}" for key in (first, second, third)))
    gone = {"selftext": word, "title": "[deleted by user]" if word == "[deleted]" else "gone"}
    older = dump(work, "older", [first, second, third], AT - 100)
    newer = dump(work, "newer", [first], AT, **gone)
    reason = word.strip("[]")
    # Whatever the order of the files, in one run or in two.
    for files in ([[older, newer]], [[newer, older]], [[newer], [older]], [[older], [newer]]):
        for each in files:
            from_dumps(work, ids, each)
        assert missing(work) == {f"t3_{first}": reason}, files
        assert {row["post_id"] for row in rows(work.place / "out" / "posts")} == {second, third}
        title = work.world.posts[first]["title"]
        assert not [path for path, text in texts(work.place / "out").items() if title in text]
        shutil.rmtree(work.place / "out")


def test_what_reddit_says_is_gone_no_older_dump_brings_back(work: Work) -> None:
    first, second = live(work, 2)
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{first}\nt3_{second}")
    work.world.gone.add(f"t3_{first}")
    work.rebuild(ids)
    from_dumps(work, ids, [dump(work, "old", [first, second], AT - 100)])
    assert missing(work) == {f"t3_{first}": "missing"}
    (row,) = rows(work.place / "out" / "posts")
    assert (row["post_id"], row["score_source"]) == (second, "live")  # the newer answer
    # One that was read later shows that it is there again.
    from_dumps(work, ids, [dump(work, "new", [first], AT + 100)])
    assert missing(work) == {}


def test_a_removal_without_a_date_is_not_undone(work: Work) -> None:
    (key,) = live(work, 1)
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{key}")
    undated = dump(work, "undated", [key], None, selftext="[removed]")
    from_dumps(work, ids, [dump(work, "dated", [key], AT - 100), undated])
    assert missing(work) == {f"t3_{key}": "removed"}
    from_dumps(work, ids, [dump(work, "again", [key], AT - 50)])
    assert missing(work) == {f"t3_{key}": "removed"}


def test_what_was_purged_is_not_taken_out_of_a_dump(work: Work) -> None:
    first, second = live(work, 2)
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{first}\nt3_{second}")
    tombstones.add_tombstones(work.root, "reddit", [(f"t3_{first}", "named")])
    from_dumps(work, ids, [dump(work, "old", [first, second])])
    assert missing(work) == {f"t3_{first}": "purged"}
    assert {row["post_id"] for row in rows(work.place / "out" / "posts")} == {second}


def test_a_limit_and_a_kill_are_gone_on_from(whole: Work, far: Work, month: list[Path]) -> None:
    with pytest.raises(LimitReached):
        from_dumps(far, released(whole), month, limit=40)
    words = ["--ids", str(released(whole)), "--out", str(far.place / "out"), "--dumps"]
    child = far.job().start("reddit", "reconstruct", *words, *map(str, month))
    while child.poll() is None and not child.output()[1]:  # it has not begun
        time.sleep(0.005)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    from_dumps(far, released(whole), month)
    for name in ("posts", "comments"):
        found = rows(far.place / "out" / name)
        assert plain(found) == plain(whole.table("clean", "reddit", name))
    left = [path.name for path in (far.place / "out").iterdir() if path.name.startswith(".work")]
    assert left == []


def test_damaged_lines_are_counted_and_what_is_no_dump_is_refused(work: Work) -> None:
    (key,) = live(work, 1)
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{key}")
    record = next(archived([work.world.posts[key]]))
    cut = write(work.place / "cut.zst", [b'{"id": "a', record, b"nothing"], frames=1)
    assert from_dumps(work, ids, [cut])["bad_lines"] == 2
    assert len(rows(work.place / "out" / "posts")) == 1
    with pytest.raises(SettingError, match="is not a dump"):
        from_dumps(work, ids, [ids])


def test_a_release_that_names_its_subreddit_takes_lines_of_it_alone(work: Work, make_rows) -> None:
    """They are found as an import finds them; ids of a list may be of any subreddit."""
    own, elsewhere = live(work, 2)
    folder = work.place / "released"
    folder.mkdir()
    ids = make_rows("reddit/posts", 2, released=True, post_id=[own, elsewhere])
    pq.write_table(ids, folder / "posts-00000-of-00001.parquet")
    here, there = archived([work.world.posts[own], work.world.posts[elsewhere]])
    month = write(work.place / "month.zst", [here, {**there, "subreddit": "gardening"}], frames=1)
    assert from_dumps(work, folder, [month])["posts"] == 2
    (folder / "profile.toml").write_text('[reddit]\nsubreddit = "Minecraft"\n')
    shutil.rmtree(work.place / "out")
    assert from_dumps(work, folder, [month])["posts"] == 1
    assert missing(work) == {f"t3_{elsewhere}": "not in these dumps"}
