"""Spans, rounds and stops of an import: nothing is written over, nothing is left out in silence,
nothing half-read stays.
"""

import json
import os
import random
import shutil
import signal
import time
from datetime import UTC, datetime

import pytest

from kb.core.errors import Interrupted, LimitReached
from kb.core.progress import LineProgress, Progress
from kb.core.signals import stop
from kb.crawl.purge import remove_keys
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps import cursor, known_dumps
from kb.reddit.dumps.import_file import ImportJob, import_file
from kb.reddit.dumps.known_dumps import note_name, samples_of
from kb.reddit.parse.anonymize import load_key
from kb.reddit.purge import RULES
from kb.registry import SOURCES as CLASSES
from kb.store import lock
from kb.store.rawlog import rawlog
from kb.verify.root import verify
from tests import processes
from tests.cli.conftest import clean_environment
from tests.reddit.dumped import imported, post, run_in, write

DAYS = [post(f"p{n:03d}", created_utc=1_600_000_000 + n * 86_400) for n in range(100)]
HALF = datetime.fromtimestamp(1_600_000_000 + 50 * 86_400, UTC)


def ids(root):
    return sorted(data["id"] for _, data in imported(root))


def test_another_span_is_another_import(tmp_path, capsys):
    dump = write(tmp_path / "RS.zst", DAYS)
    run = run_in(tmp_path, progress=LineProgress())
    assert import_dumps(run, [dump], since=HALF)["crawled"] == 50
    assert import_dumps(run, [dump])["crawled"] == 100
    capsys.readouterr()
    assert import_dumps(run, [dump])["crawled"] == 0
    assert "RS.zst: already imported (100 posts and comments)" in capsys.readouterr().err
    assert len(ids(tmp_path)) == 150
    assert set(ids(tmp_path)) == {one["id"] for one in DAYS}


def test_again_writes_over_nothing(tmp_path):
    dump = write(tmp_path / "RS.zst", DAYS)
    import_dumps(run_in(tmp_path), [dump])
    assert import_dumps(run_in(tmp_path, again=True), [dump], since=HALF)["crawled"] == 50
    assert import_dumps(run_in(tmp_path, again=True), [dump])["crawled"] == 100
    assert len(ids(tmp_path)) == 150, "what a later round reads the same is there once"
    assert set(ids(tmp_path)) == {one["id"] for one in DAYS}
    assert not list((tmp_path / "raw").rglob(".*")), "and leaves nothing hidden"


def test_what_an_earlier_version_left_of_again_goes_with_the_next_command(tmp_path):
    dump = write(tmp_path / "RS.zst", DAYS)
    import_dumps(run_in(tmp_path), [dump])
    (segment,) = rawlog.segments(tmp_path, "reddit", "dumps")
    left = segment.with_name(f".{segment.name}.part")
    shutil.copy(segment, left)
    unfinished = segment.with_name(f".000009{segment.name[6:]}.part")
    shutil.copy(segment, unfinished)
    (leftover, other) = sorted(
        verify(tmp_path, Progress()).of_kinds("leftovers"), key=lambda one: one.path
    )
    assert (leftover.path, other.path) == tuple(sorted((left, unfinished)))
    with lock.writer(tmp_path, "reddit"):
        assert not left.exists()
        assert unfinished.exists()  # its note may still name it: the next import decides


def test_again_goes_on_where_it_was_stopped(tmp_path):
    dumps = [
        write(tmp_path / f"RS_{n}.zst", [post(f"f{n}p{m:02d}") for m in range(30)])
        for n in range(2)
    ]
    import_dumps(run_in(tmp_path), dumps)
    taken = []
    for _ in range(3):
        try:
            taken.append(import_dumps(run_in(tmp_path, again=True, limit=25), dumps)["crawled"])
        except LimitReached as stopped:
            taken.append(stopped.summary["crawled"])
    assert taken == [25, 25, 10]
    assert set(ids(tmp_path)) == {f"f{n}p{m:02d}" for n in range(2) for m in range(30)}


def test_spans_of_two_machines_in_one_folder(tmp_path):
    dump = write(tmp_path / "RS.zst", DAYS)
    import_dumps(run_in(tmp_path / "a"), [dump], until=HALF)
    import_dumps(run_in(tmp_path / "b"), [dump], since=HALF)
    for machine in "ab":
        shutil.copytree(tmp_path / machine / "raw", tmp_path / "both" / "raw", dirs_exist_ok=True)
    assert ids(tmp_path / "both") == [one["id"] for one in DAYS]


def test_a_half_imported_copy_takes_nothing_from_a_whole_one(tmp_path):
    dump = write(tmp_path / "RS.zst", DAYS)
    load_key(tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "half")
    import_dumps(run_in(tmp_path / "whole"), [dump])
    with pytest.raises(LimitReached):
        import_dumps(run_in(tmp_path / "half", limit=30), [dump])
    shutil.copytree(tmp_path / "half" / "raw", tmp_path / "whole" / "raw", dirs_exist_ok=True)
    assert set(ids(tmp_path / "whole")) == {one["id"] for one in DAYS}


def test_a_dump_that_is_given_twice_is_read_once(tmp_path, capsys):
    dump = write(tmp_path / "RS.zst", DAYS)
    (tmp_path / "copy").mkdir()
    shutil.copy(dump, tmp_path / "copy" / "RS.zst")
    summary = import_dumps(
        run_in(tmp_path, workers=2, progress=LineProgress()),
        [dump, dump, tmp_path / "copy" / "RS.zst"],
    )
    assert (summary["crawled"], len(ids(tmp_path))) == (100, 100)
    assert capsys.readouterr().err.count("same dump as") == 2


@pytest.mark.parametrize(("workers", "number"), [(1, signal.SIGTERM), (2, signal.SIGINT)])
def test_a_signal_ends_it_within_a_dump(tmp_path, workers, number):
    text = random.Random(1).randbytes(15_000).hex()
    lines = [
        [post(f"p{m}{n:06d}", selftext=text[n % 29_000 :][:900]) for n in range(15_000)]
        for m in range(workers)
    ]
    dumps = [write(tmp_path / f"RS_{m}.zst", posts) for m, posts in enumerate(lines)]
    words = [
        "reddit",
        "import",
        *map(str, dumps),
        "--data",
        str(tmp_path / "data"),
        "--workers",
        str(workers),
        "--json",
    ]
    # A shell without job control starts background jobs with SIGINT ignored, and children inherit
    # that.
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from"
        " kb.cli import main; main()"
    )
    child = processes.program(program, *words, env=clean_environment())
    base = rawlog.folder(tmp_path / "data", "reddit", "dumps")
    while child.poll() is None and not any(base.glob(".*.part")):
        time.sleep(0.005)
    child.send_signal(number)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 3, err
    summary = json.loads(out.splitlines()[-1])
    assert 0 < summary["crawled"] == len(imported(tmp_path / "data")) < 15_000 * workers
    assert {"lines", "bad_lines", "truncated_files", "requests", "stopped"} <= summary.keys()
    assert not list(base.glob(".*"))
    assert (
        import_dumps(run_in(tmp_path / "data"), dumps)["crawled"]
        == 15_000 * workers - summary["crawled"]
    )
    assert set(ids(tmp_path / "data")) == {one["id"] for posts in lines for one in posts}


def test_a_request_to_stop_reaches_a_worker_while_it_skips(tmp_path):
    dump = write(tmp_path / "RS.zst", DAYS)
    job = ImportJob(str(tmp_path), str(dump), "Minecraft", 0.0, float("inf"), 40)
    import_file(job)
    left = import_file(
        ImportJob(
            str(tmp_path),
            str(dump),
            "Minecraft",
            0.0,
            float("inf"),
            0,
            lease=str(tmp_path / "gone"),
        )
    )
    assert (left.things, left.done) == (40, False)
    assert import_file(job).things == 80


def test_a_stop_before_the_first_file_says_so(tmp_path):
    stop.request("SIGTERM")
    try:
        with pytest.raises(Interrupted, match="SIGTERM") as stopped:
            import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", DAYS)])
    finally:
        stop.clear()
    assert stopped.value.summary["crawled"] == 0


def test_what_a_killed_import_left_is_noted_or_gone_before_a_purge(tmp_path):
    """Killed between note and rename, and within a segment: the purge reaches the first, the second
    is read again.
    """
    chance = random.Random(1)
    posts = [
        post(f"p{n:05d}", title=f"TITLE{n:05d}", selftext=chance.randbytes(300).hex())
        for n in range(4_000)
    ]
    dump = write(tmp_path / "RS.zst", posts)
    import_file(ImportJob(str(tmp_path), str(dump), "Minecraft", 0.0, float("inf"), 300))
    name = note_name(dump, 0.0, float("inf"))
    place, base = cursor.load_cursor(tmp_path, name), rawlog.folder(tmp_path, "reddit", "dumps")
    os.rename(base / place.segment, cursor.hidden(base, place.segment))
    cursor.hidden(base, name).write_bytes(b"TITLE00301")
    (tmp_path / "ids.txt").write_text("t3_p00001\nt3_p00301\n")
    remove_keys(
        run_in(tmp_path),
        CLASSES["reddit"].connector(run_in(tmp_path)),
        RULES,
        RULES.read_ids(tmp_path / "ids.txt", None),
    )
    assert not list(base.glob(".*"))
    assert len(ids(tmp_path)) == 299
    import_dumps(run_in(tmp_path), [dump])
    assert ids(tmp_path) == [f"p{n:05d}" for n in range(4_000) if n not in (1, 301)]


def test_a_repaired_dump_of_the_same_size_and_beginning_is_read(tmp_path):
    """Of the same name, too: what was broken far behind its beginning is told by what stands
    there, or, where that is not looked at, by the time of a dump that was damaged.
    """
    chance = random.Random(1)
    noise = [post(f"n{n}", selftext=chance.randbytes(6_000).hex()) for n in range(60)]
    dump = write(tmp_path / "RS.zst", noise, frames=60)
    whole = dump.read_bytes()
    assert len(whole) > 4 * known_dumps._START
    for at in (len(whole) // 2, len(whole) - 700):
        broken = bytearray(whole)
        broken[at : at + 500] = bytes(500)
        dump.write_bytes(broken)
        root = tmp_path / str(at)
        assert import_dumps(run_in(root), [dump])["crawled"] < len(noise)
        dump.write_bytes(whole)
        import_dumps(run_in(root), [dump])
        assert len(set(ids(root))) == len(noise)
        assert import_dumps(run_in(root), [dump])["crawled"] == 0


def noise(path, name="n", changed=()):
    """A dump of 8 MB, of which samples alone don't tell all; the posts `changed` have other ids, of
    the same length.
    """
    chance = random.Random(1)
    texts = [chance.randbytes(3_000).hex() for _ in range(1_300)]
    keys = [f"{'x' if n in changed else name}{n:04d}" for n in range(len(texts))]
    lines = [json.dumps(post(key, selftext=text)) for key, text in zip(keys, texts, strict=True)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, ""]))
    return path


def test_dumps_of_one_name_size_and_time_are_told_apart_by_their_content(tmp_path, capsys):
    """Also where they differ only in what no sample holds; a copy of one is read once, whatever it
    is called, and hashed once.
    """
    first = noise(tmp_path / "a" / "dump.ndjson")
    second = next(
        path
        for n in range(600, 700)
        if samples_of(path := noise(tmp_path / "b" / "dump.ndjson", changed=(n,)))
        == samples_of(first)
    )
    assert second.stat().st_size == first.stat().st_size
    for path in (first, second):
        os.utime(path, (1_600_000_000, 1_600_000_000))
    run = run_in(tmp_path / "data", progress=LineProgress())
    assert import_dumps(run, [first])["crawled"] == 1_300
    assert import_dumps(run, [second])["crawled"] == 1_300
    assert len(set(ids(tmp_path / "data"))) == 1_301
    copy = tmp_path / "c" / "other name.ndjson"
    copy.parent.mkdir()
    shutil.copyfile(second, copy)
    for path in (first, second, copy, copy):
        capsys.readouterr()
        assert import_dumps(run, [path])["crawled"] == 0
        assert "already imported (1300" in (shown := capsys.readouterr().err)
    assert "compare" not in shown  # the copy has a note of its own now
    both = run_in(tmp_path / "both", progress=LineProgress())
    for crawled in (2_600, 0, 0):
        assert import_dumps(both, [first, second, copy])["crawled"] == crawled
        assert (shown := capsys.readouterr().err).count("same dump as") == 1
    assert "compare" not in shown
