"""Reading a month's dump for one subreddit: lines a second of one core, beside other ways in the
same run.

    json        every line through the standard library, the field compared
    orjson      the same with orjson
    DuckDB      read_json with explicit columns on the same file, one thread
    ours        names searched in chunks, orjson on hits, names hashed, envelopes written
    as …        ours, the same lines in another container
    ids of …    the same things by their full names: of a release, which names its subreddit, or of
                a list, whose ids may be of any

Half a percent of the lines are wanted, as in a monthly file of all subreddits.
"""

import gzip
import json
import os
import string
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import accumulate
from pathlib import Path

import orjson
import pytest
import zstandard

from kb.core import clock
from kb.reddit.dumps.import_file import ImportJob, import_file
from kb.reddit.dumps.search import write_index
from tests.reddit.dumped import blocks

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1800)]
LINES = int(os.environ.get("KB_BENCH_LINES", "400000"))
ROUNDS = 5


# What a comment of 2023 has besides; one of 2012 doesn't. Most are empty in most lines, as in the
# archive's.
LATER = {
    "all_awardings": [],
    "approved_at_utc": None,
    "approved_by": None,
    "archived": False,
    "associated_award": None,
    "author_created_utc": 1_500_000_000,
    "author_flair_background_color": None,
    "author_flair_css_class": None,
    "author_flair_richtext": [],
    "author_flair_template_id": None,
    "author_flair_text": None,
    "author_flair_text_color": None,
    "author_flair_type": "text",
    "author_is_blocked": False,
    "author_patreon_flair": False,
    "author_premium": False,
    "awarders": [],
    "banned_at_utc": None,
    "banned_by": None,
    "can_gild": True,
    "can_mod_post": False,
    "collapsed": False,
    "collapsed_because_crowd_control": None,
    "collapsed_reason": None,
    "collapsed_reason_code": None,
    "comment_type": None,
    "created": 1_700_000_000,
    "downs": 0,
    "gildings": {},
    "is_submitter": False,
    "likes": None,
    "locked": False,
    "mod_note": None,
    "mod_reason_by": None,
    "mod_reason_title": None,
    "mod_reports": [],
    "nest_level": 1,
    "no_follow": True,
    "num_reports": None,
    "removal_reason": None,
    "replies": "",
    "report_reasons": None,
    "saved": False,
    "send_replies": True,
    "subreddit_name_prefixed": "r/all",
    "subreddit_type": "public",
    "top_awarded_type": None,
    "treatment_tags": [],
    "unrepliable_reason": None,
    "updated_on": None,
    "ups": 1,
    "user_reports": [],
}


IDS = {
    "Minecraft": "t5_2r05i",
    "gardening": "t5_2qhw1",
    "trains": "t5_2qlwi",
    "AskAnything": "t5_2tq4p",
    "pics": "t5_2qh0u",
}


WORDS = 20_000  # different ones, the n-th said 1/n as often as the first


def write(path: Path, lines: int, later: dict[str, object]) -> None:
    """A monthly file: comments of many subreddits, half a percent of them Minecraft's.

    It is compressed as the archive's files are, with a window of 2 GiB.
    """
    rng = clock.rng("bench dumps")
    letters = string.ascii_lowercase
    words = ["".join(rng.choices(letters, k=rng.randint(2, 9))) for _ in range(WORDS)]
    often = list(accumulate(1 / rank for rank in range(1, WORDS + 1)))
    others = [name for name in IDS if name != "Minecraft"]
    window = zstandard.ZstdCompressionParameters.from_level(3, window_log=31, enable_ldm=True)
    engine = zstandard.ZstdCompressor(compression_params=window)
    with path.open("wb") as file, engine.stream_writer(file) as out:
        for number in range(lines):
            name = "Minecraft" if number % 200 == 7 else rng.choice(others)
            post, person = (f"{rng.getrandbits(31):x}" for _ in range(2))
            out.write(
                json.dumps(
                    {
                        "id": f"c{number:07x}",
                        "subreddit": name,
                        "author": f"{words[number % 977]}{person}",
                        "author_fullname": f"t2_{person}",
                        "link_id": f"t3_{post}",
                        "parent_id": f"t1_{rng.getrandbits(31):x}",
                        "created_utc": 1_700_000_000 + number,
                        "retrieved_on": 1_701_000_000 + number,
                        "score": number % 90,
                        "body": " ".join(
                            rng.choices(words, cum_weights=often, k=rng.randint(5, 55))
                        ),
                        "permalink": f"/r/{name}/comments/{post}/post/c{number:07x}/",
                        "edited": False,
                        "distinguished": None,
                        "stickied": False,
                        "controversiality": 0,
                        "gilded": 0,
                        "score_hidden": False,
                        "subreddit_id": IDS[name],
                        "total_awards_received": 0,
                        **later,
                    }
                ).encode()
                + b"\n"
            )


def lines_of(path: Path) -> Iterator[bytes]:
    """Every line, streamed."""
    with (
        path.open("rb") as file,
        zstandard.ZstdDecompressor(max_window_size=1 << 31).stream_reader(file) as reader,
    ):
        rest = b""
        while chunk := reader.read(4 << 20):
            *whole, rest = (rest + chunk).split(b"\n")
            yield from whole


def parsed(loads: Callable[[bytes], dict], path: Path) -> int:
    """How many lines are wanted, reading each."""
    return sum(1 for line in lines_of(path) if loads(line)["subreddit"] == "Minecraft")


def with_duckdb(path: Path) -> int:
    import duckdb

    con = duckdb.connect(config={"threads": 1})
    texts = dict.fromkeys(("id", "subreddit", "author", "link_id", "parent_id", "body"), "VARCHAR")
    columns = texts | {"created_utc": "BIGINT", "score": "BIGINT"}
    rows = con.execute(
        f"""SELECT count(*), max(length(body))
        FROM read_json('{path}', format='newline_delimited', compression='zstd', columns={columns})
        WHERE subreddit = 'Minecraft'"""
    ).fetchone()
    return rows[0]


def ours(path: Path, root: Path) -> int:
    return import_file(ImportJob(str(root), str(path), "Minecraft", 0.0, float("inf"), 0)).things


def by_id(path: Path, root: Path, ids: Path, subreddit: str) -> int:
    """The same things by their names, as a reconstruction takes them."""
    job = ImportJob(str(root), str(path), subreddit, 0.0, float("inf"), 0, ids=str(ids))
    return import_file(job).things


@pytest.mark.parametrize("later", [{}, LATER], ids=["2012", "2023"])
def test_six_times_json(tmp_path, record_property, later):
    """Each way once a round and the best of its rounds:
    what else a machine does can only slow a way down.
    """
    path = tmp_path / "RC_2024-01.zst"
    write(path, LINES, later)
    ids = tmp_path / "ids"
    write_index((f"t1_c{number:07x}" for number in range(7, LINES, 200)), (), ids)
    ways: dict[str, Callable[[int], int]] = {
        "json": lambda turn: parsed(json.loads, path),
        "orjson": lambda turn: parsed(orjson.loads, path),
        "DuckDB": lambda turn: with_duckdb(path),
        "ours": lambda turn: ours(path, tmp_path / f"root{turn}"),
        "ids of a release": lambda turn: by_id(path, tmp_path / f"some{turn}", ids, "Minecraft"),
        "ids of a list": lambda turn: by_id(path, tmp_path / f"any{turn}", ids, ""),
    }
    text = b"".join(line + b"\n" for line in lines_of(path))
    for name, pack in {"plain": bytes, "gzip": gzip.compress, "zst_blocks": blocks}.items():
        packed = tmp_path / name
        packed.write_bytes(pack(text))
        ways[f"as {name}"] = lambda turn, packed=packed: ours(
            packed, tmp_path / f"{packed.name}{turn}"
        )
    del text
    rates: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(ROUNDS):
        for name, call in ways.items():
            start = time.process_time()
            assert call(turn) == LINES // 200
            rates[name].append(LINES / (time.process_time() - start))
    best = {name: max(found) for name, found in rates.items()}
    print(f"\n{LINES:,} lines, lines a second of one core (best of {ROUNDS}), x json")
    for name, rate in best.items():
        print(f"  {name:16} {rate:>12,.0f}  {rate / best['json']:5.1f}x")
        record_property(name, round(rate / best["json"], 2))
    assert best["ours"] >= 6 * best["json"]


def test_memory_does_not_grow_with_the_file(tmp_path, record_property):
    peaks = {}
    for lines in (LINES // 4, LINES):
        path = tmp_path / f"RC_{lines}.zst"
        write(path, lines, LATER)
        program = (
            "import sys; import resource;"
            " from kb.reddit.dumps.import_file import ImportJob, import_file;"
            "import_file(ImportJob(sys.argv[2], sys.argv[1], 'Minecraft', 0.0, float('inf'),"
            " 0)); print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
        )
        done = subprocess.run(
            [sys.executable, "-c", program, str(path), str(tmp_path / f"root{lines}")],
            capture_output=True,
            text=True,
            check=True,
        )
        peaks[lines] = int(done.stdout) / 1024
    print(
        "\npeak memory, MiB: "
        + ", ".join(f"{lines:,} lines {peak:.0f}" for lines, peak in peaks.items())
    )
    record_property("peaks", peaks)
    small, large = peaks.values()
    assert large < 1.25 * small
