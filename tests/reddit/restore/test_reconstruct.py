"""Reconstruction brings back everything that is still there, at a hundred ids a request, and names
the rest.
"""

import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb.reddit
from kb.core.errors import LimitReached, SettingError, Unreachable, WriterLocked
from kb.sandbox.invented_ids import PEOPLE
from kb.schema import table
from tests import processes
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.work import LATER, Work, rows, texts

COMPARED = ("author_hash", "score_source", "fetched_at")


def released(whole: Work) -> Path:
    return whole.root / "release" / "reddit"


def packed(posts: int, comments: int) -> float:
    return 1.02 * (-(-posts // 100) + -(-comments // 100))


def plain(found: list[dict[str, object]]) -> list[dict[str, object]]:
    return [{name: value for name, value in row.items() if name not in COMPARED} for row in found]


def test_a_release_comes_back_whole_at_the_price_that_was_promised(whole: Work, far: Work) -> None:
    since = len(far.sandbox.ledger)
    summary = far.rebuild(released(whole))
    posts, comments = (
        whole.table("clean", "reddit", "posts"),
        whole.table("clean", "reddit", "comments"),
    )
    asked = [
        seen for seen in far.sandbox.ledger.requests(since=since) if "access_token" not in seen.path
    ]
    assert len(asked) == summary["requests"] - 1 <= packed(len(posts), len(comments))
    assert plain(rows(far.place / "out" / "posts")) == plain(posts)
    assert plain(rows(far.place / "out" / "comments")) == plain(comments)
    assert pq.read_table(far.place / "out" / "missing.parquet").num_rows == 0
    for name in ("posts", "comments"):
        for part in (far.place / "out" / name).iterdir():
            assert (
                pq.read_schema(part)
                .remove_metadata()
                .equals(table(f"reddit/{name}").arrow().remove_metadata())
            )


def test_hashes_are_of_this_root_alone_and_no_name_is_written(whole: Work, far: Work) -> None:
    with pytest.raises(LimitReached):
        far.rebuild(released(whole), limit=300)
    far.rebuild(released(whole))
    mine = {row["author_hash"] for row in rows(far.place / "out" / "comments")} - {None}
    theirs = {row["author_hash"] for row in whole.table("clean", "reddit", "comments")} - {None}
    assert len(mine) == len(theirs)
    assert not mine & theirs
    for path, text in texts(far.place).items():
        assert not [name for name in PEOPLE if name in text], path


def test_what_is_gone_is_named_with_its_reason_and_no_failure(tmp_path: Path) -> None:
    world = small_world(24, width=20, depth=12)
    with Sandbox(world, services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path)
        posts, comments = list(world.reddit.posts), list(world.reddit.comments)
        live = [
            key
            for key in comments
            if world.reddit.comments[key]["body"] not in ("[deleted]", "[removed]")
        ]
        world.reddit.gone |= {f"t3_{posts[0]}", f"t1_{live[0]}"}
        world.reddit.removed |= {f"t3_{posts[1]}", f"t1_{live[1]}"}
        ids = tmp_path / "ids.txt"
        ids.write_text(
            "\n".join(
                [f"t3_{key}" for key in posts]
                + [f"t1_{key}" for key in comments]
                + ["t1_zzzzzz", "t3_zzzzzz", "t3_zzzzzz", ""]
            )
        )
        summary = work.rebuild(ids)
    missing = {
        row["key"]: row["reason"]
        for row in pq.read_table(tmp_path / "out" / "missing.parquet").to_pylist()
    }
    answered = {f"t3_{row['post_id']}" for row in rows(tmp_path / "out" / "posts")} | {
        f"t1_{row['comment_id']}" for row in rows(tmp_path / "out" / "comments")
    }
    assert not answered & missing.keys()
    assert answered | missing.keys() == {line for line in ids.read_text().split("\n") if line}
    assert summary["missing"] == len(missing)
    assert {
        missing[name] for name in ("t1_zzzzzz", "t3_zzzzzz", f"t3_{posts[0]}", f"t1_{live[0]}")
    } == {"missing"}
    assert {missing[f"t3_{posts[1]}"], missing[f"t1_{live[1]}"]} == {"removed"}
    assert Counter(missing.values())["malformed"] == 1  # the post without a score
    orphan = [
        row for row in rows(tmp_path / "out" / "comments") if row["parent_id"] == f"t1_{live[0]}"
    ]
    assert all(row["depth"] is None for row in orphan)


def test_one_python_call_yields_typed_rows(whole: Work, tmp_path: Path) -> None:
    key, comment = (
        whole.table("clean", "reddit", "posts")[0]["post_id"],
        whole.table("clean", "reddit", "comments")[0],
    )
    settings = {name.lower(): value for name, value in whole.sandbox.settings().items()}
    found = list(
        kb.reddit.reconstruct(
            [f"t3_{key}", f"t1_{comment['comment_id']}", "t3_zzzz"], kb_data=tmp_path, **settings
        )
    )
    assert [type(row).__name__ for row in found] == ["Post", "Comment", "Missing"]
    assert (found[0].post_id, found[0].title) == (key, whole.world.posts[key]["title"])
    assert (found[1].body, found[1].created_utc) == (comment["body"], comment["created_utc"])
    assert found[2] == kb.reddit.Missing("t3_zzzz", "missing")


def test_the_call_has_its_name_whatever_was_imported_before() -> None:
    code = (
        "import kb.reddit, kb.cli.commands.sources, kb.reddit.restore.reconstruct; assert"
        " callable(kb.reddit.reconstruct)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ids.txt", "t2_abc\n"),
        ("ids.txt", "\n"),
        ("reddit.json", "{}"),
        ("reddit.json", '[{"type": "text"}]'),
        ("reddit.json", "["),
    ],
)
def test_a_file_of_no_use_is_said_before_anything_is_sent(work: Work, name: str, text: str) -> None:
    path = work.place / name
    path.write_text(text)
    with pytest.raises(SettingError) as error:
        work.rebuild(path)
    assert error.value.exit_code == 2
    if not isinstance(error.value.__context__, ValueError):
        assert "--ids FILE" in error.value.hint
    assert len(work.sandbox.ledger) == 0


@pytest.mark.parametrize(
    "name",
    [
        "posts/mine.txt",
        "comments/part-00000.parquet",
        "posts/part-00000.parquet/mine.txt",
        "posts",
        "comments/.notes",
    ],
)
def test_a_folder_with_other_files_is_refused_before_anything_is_sent(
    work: Work, name: str
) -> None:
    ids, mine = work.place / "ids.txt", work.place / "out" / name
    ids.write_text(f"t3_{next(iter(work.world.posts))}")
    mine.parent.mkdir(parents=True)
    mine.write_text("dear")
    with pytest.raises(SettingError, match="was not made by a reconstruction"):
        work.rebuild(ids)
    assert mine.read_text() == "dear"
    assert len(work.sandbox.ledger) == 0
    with pytest.raises(SettingError, match="not a folder"):
        work.rebuild(ids, ids)


def test_a_file_beside_its_own_tables_is_refused_too(work: Work) -> None:
    ids, mine = work.place / "ids.txt", work.place / "out" / "posts" / "mine.txt"
    ids.write_text(f"t3_{next(iter(work.world.posts))}")
    assert work.rebuild(ids)["posts"] == 1
    assert work.rebuild(ids, again=True)["posts"] == 1
    mine.write_text("dear")
    with pytest.raises(SettingError, match=r"mine\.txt"):
        work.rebuild(ids, again=True)
    assert mine.exists()


@pytest.mark.parametrize(
    "lost", ["posts", "comments", "missing.parquet", "posts/part-00000.parquet"]
)
def test_tables_that_were_removed_are_asked_for_again(work: Work, lost: str) -> None:
    ids, path = work.place / "ids.txt", work.place / "out" / lost
    ids.write_text(f"t3_{next(iter(work.world.posts))}\nt3_nowhere")
    first = work.rebuild(ids)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert work.rebuild(ids) == first
    assert path.exists()
    assert work.rebuild(ids)["requests"] == 0


def test_lines_that_are_no_names_are_counted(work: Work) -> None:
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{next(iter(work.world.posts))}\nabc\nnot a name\n")
    summary = work.rebuild(ids)
    assert (summary["posts"], summary["bad_lines"]) == (1, 2)


def test_without_a_release_or_ids_the_hint_names_both(work: Work) -> None:
    line = work.job().stopped("reddit", "reconstruct", code=2)
    assert "`kb reddit reconstruct --ids release/reddit`" in line
    assert "kb reddit export" in line
    assert "No such file" not in line
    assert len(work.sandbox.ledger) == 0


def test_the_same_ids_are_the_same_reconstruction_in_whatever_form(work: Work) -> None:
    names = [f"t3_{key}" for key in list(work.world.posts)[:3]] + ["t3_nowhere", "t1_nowhere"]
    pq.write_table(pa.table({"key": names}), work.place / "ids.parquet")
    (work.place / "ids.txt").write_text("\n".join(names))
    summary = work.rebuild(work.place / "ids.parquet")
    assert (summary["posts"], summary["missing"]) == (3, 2)
    assert list(missing(work).items()) == [("t1_nowhere", "missing"), ("t3_nowhere", "missing")]
    assert work.rebuild(work.place / "ids.txt")["requests"] == 0


def shards(whole: Work, name: str) -> Path:
    (path,) = released(whole).glob(f"{name}-*.parquet")
    return path


def missing(work: Work) -> dict[str, str]:
    rows = pq.read_table(work.place / "out" / "missing.parquet").to_pylist()
    return {row["key"]: row["reason"] for row in rows}


def is_whole(whole: Work, far: Work) -> bool:
    return all(
        plain(rows(far.place / "out" / name)) == plain(whole.table("clean", "reddit", name))
        for name in ("posts", "comments")
    )


def test_a_second_list_of_ids_adds_to_what_is_there(whole: Work, far: Work) -> None:
    first = far.rebuild(shards(whole, "posts"))
    assert first["comments"] == 0
    second = far.rebuild(shards(whole, "comments"))
    assert (second["posts"], second["missing"]) == (first["posts"], 0)
    assert is_whole(whole, far)
    since = len(far.sandbox.ledger)
    for name in ("posts", "comments"):
        assert far.rebuild(shards(whole, name))["requests"] == 0
    assert len(far.sandbox.ledger) == since
    assert is_whole(whole, far)


def test_half_a_thread_after_the_other_has_its_depths(whole: Work, far: Work) -> None:
    names = [f"t1_{row['comment_id']}" for row in whole.table("clean", "reddit", "comments")]
    names += [f"t3_{row['post_id']}" for row in whole.table("clean", "reddit", "posts")]
    for number in (1, 0):
        ids = far.place / f"{number}.txt"
        ids.parent.mkdir(parents=True, exist_ok=True)
        ids.write_text("\n".join(names[number::2]))
        far.rebuild(ids)
    found = {row["comment_id"]: row for row in rows(far.place / "out" / "comments")}
    for row in whole.table("clean", "reddit", "comments"):
        # Without a release's depths they are known where no ancestor is gone.
        assert found[row["comment_id"]]["depth"] in (None, row["depth"])
        assert found[row["comment_id"]]["parent_in_release"] == row["parent_in_release"]
    assert sum(row["depth"] is None for row in found.values()) < 60


def test_ids_may_be_given_several_times(whole: Work, far: Work) -> None:
    (far.place / "more.txt").parent.mkdir(parents=True, exist_ok=True)
    (far.place / "more.txt").write_text("t3_nowhere")
    words = ["--ids", str(far.place / "more.txt"), "--out", str(far.place / "out")]
    for name in ("posts", "comments"):
        words += ["--ids", str(shards(whole, name))]
    summary = far.job().done("reddit", "reconstruct", *words)
    assert summary["missing"] == 1
    assert missing(far) == {"t3_nowhere": "missing"}
    assert is_whole(whole, far)


def test_what_is_removed_later_leaves_and_what_comes_back_is_not_missing(
    work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    posts = [key for key, row in work.world.posts.items() if row.get("score")][:4]
    ids, other = work.place / "ids.txt", work.place / "other.txt"
    ids.write_text("\n".join(f"t3_{key}" for key in posts))
    other.write_text(f"t3_{posts[0]}\nt3_{posts[1]}")
    work.rebuild(ids)
    work.world.removed.add(f"t3_{posts[0]}")
    work.world.gone.add(f"t3_{posts[1]}")
    summary = work.rebuild(other)
    assert (summary["posts"], summary["missing"]) == (2, 2)
    assert missing(work) == {f"t3_{posts[0]}": "removed", f"t3_{posts[1]}": "missing"}
    title = work.world.posts[posts[0]]["title"]
    assert title not in {row["title"] for row in rows(work.place / "out" / "posts")} - {
        work.world.posts[key]["title"] for key in posts[2:]
    }
    assert {row["post_id"] for row in rows(work.place / "out" / "posts")} == set(posts[2:])
    work.world.gone.clear()
    monkeypatch.setenv("KB_NOW", LATER)
    work.rebuild(other, again=True)
    assert missing(work) == {f"t3_{posts[0]}": "removed"}
    assert len(rows(work.place / "out" / "posts")) == 3


def test_what_only_failed_keeps_the_older_row(work: Work) -> None:
    posts = list(work.world.posts)[:3]
    ids = work.place / "ids.txt"
    ids.write_text("\n".join(f"t3_{key}" for key in posts))
    work.rebuild(ids)
    fault = work.sandbox.faults.add("api/info", status=503, times=None)
    with pytest.raises(Unreachable):
        work.rebuild(ids, again=True)
    assert (len(rows(work.place / "out" / "posts")), missing(work)) == (3, {})
    work.sandbox.faults.remove(fault)
    assert work.rebuild(ids)["failed"] == 0


def test_an_older_run_that_goes_on_undoes_no_removal(work: Work) -> None:
    posts = list(work.world.posts)[:3]
    ids, other = work.place / "ids.txt", work.place / "other.txt"
    ids.write_text("\n".join(f"t3_{key}" for key in posts))
    other.write_text(f"t3_{posts[0]}")
    with pytest.raises(LimitReached):
        work.rebuild(ids, limit=2)
    work.world.removed.add(f"t3_{posts[0]}")
    work.rebuild(other)
    assert missing(work) == {f"t3_{posts[0]}": "removed"}
    work.rebuild(ids)  # it has read the post before that
    assert missing(work) == {f"t3_{posts[0]}": "removed"}
    assert {row["post_id"] for row in rows(work.place / "out" / "posts")} == set(posts[1:])


def test_killed_in_a_second_run_what_was_there_stays(whole: Work, far: Work) -> None:
    far.rebuild(shards(whole, "posts"))
    before = {path: path.read_bytes() for path in (far.place / "out").rglob("*.parquet")}
    held = far.sandbox.faults.add("api/info", after=3, hold=True)
    words = ["--ids", str(shards(whole, "comments")), "--out", str(far.place / "out")]
    child = far.job().start("reddit", "reconstruct", *words)
    assert held.arrived.wait(60)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    held.release()
    assert {path: path.read_bytes() for path in before} == before
    far.rebuild(shards(whole, "comments"))
    assert is_whole(whole, far)


@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_killed_between_the_renames_nothing_is_lost(whole: Work, far: Work, at: int) -> None:
    far.rebuild(shards(whole, "posts"))
    code = (
        "import os, signal\n"
        "real, left = os.rename, [%d]\n"
        "def rename(old, new):\n"
        "    if '/out/' in str(new) and '.work' not in str(new):\n"
        "        left[0] -= 1\n"
        "        if not left[0]: os.kill(os.getpid(), signal.SIGKILL)\n"
        "    real(old, new)\n"
        "os.rename = rename\n"
        "from kb.__main__ import main\nmain()\n"
    )
    words = ["reddit", "reconstruct", "--ids", str(shards(whole, "comments"))]
    words += ["--out", str(far.place / "out")]
    job = far.job()
    killed = processes.program(code % at, *words, env=job.env, cwd=job.place)
    assert killed.wait(120) == -signal.SIGKILL, killed.communicate()
    since = len(far.sandbox.ledger)
    far.rebuild(shards(whole, "comments"))
    assert len(far.sandbox.ledger.requests("api/info", since=since)) == 0
    assert is_whole(whole, far)
    assert missing(far) == {}


def test_tables_beside_a_note_of_something_else_are_added_to(whole: Work, far: Work) -> None:
    far.rebuild(shards(whole, "posts"))
    (far.place / "out" / ".done.json").write_text('{"ids": "0", "posts": 3}')
    far.rebuild(shards(whole, "comments"))
    found = {row["post_id"]: row["comments_released"] for row in rows(far.place / "out" / "posts")}
    assert found == {
        row["post_id"]: row["comments_released"] for row in whole.table("clean", "reddit", "posts")
    }


def test_two_runs_do_not_write_to_one_folder(work: Work) -> None:
    ids = work.place / "ids.txt"
    ids.write_text(f"t3_{next(iter(work.world.posts))}")
    held = work.sandbox.faults.add("api/info", hold=True)
    child = work.job().start(
        "reddit", "reconstruct", "--ids", str(ids), "--out", str(work.place / "out")
    )
    assert held.arrived.wait(60)
    other = work.place / "other.txt"
    other.write_text(f"t3_{list(work.world.posts)[1]}")
    with pytest.raises(WriterLocked, match=str(child.pid)):
        work.rebuild(other)
    held.release()
    child.communicate()
    assert child.returncode == 0
