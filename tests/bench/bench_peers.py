"""Filters, pairs and import beside the scripts that an able user would write instead (`peers/`), in
one run: CPU time, wall time and memory of both, and their ratios. Both keep the same rows.

SHARE=0.03 make bench ARGS="-k peers"       a share of your own; two workers
"""

import json
import os
import shutil
import statistics
import sys
from collections.abc import Callable
from pathlib import Path

import duckdb
import pytest

from kb.core.config.profile import load_profile
from kb.pairs import keywords
from tests.bench import bench_reddit_import, measured, scale

pytestmark = [pytest.mark.bench, pytest.mark.timeout(6 * 3600)]

SHARE = float(os.environ.get("SHARE", "0.003"))
ROUNDS = int(os.environ.get("ROUNDS", "3"))
LINES = round(SHARE * 66_000_000)  # of the dump: 2 million at a share of 0.03
PEERS = Path(__file__).with_name("peers")
Run = Callable[[], measured.Measured]


def script(name: str, *arguments: object) -> Run:
    """A run of a script of `peers/`."""
    start = [] if name.endswith(".sh") else [sys.executable]
    command = [*start, str(PEERS / name), *map(str, arguments)]
    env = {**os.environ, "PYTHONPATH": str(scale.HERE)}
    return lambda: measured.run(command, env, PEERS)


def beside(name: str, ways: dict[str, Run]) -> None:
    """Run the ways in turn, and print the median of each, and its ratio to the first one's; behind
    that the ratios of the least figures, which other work of the machine changes less.
    """
    found: dict[str, list[measured.Measured]] = {way: [] for way in ways}
    for _ in range(ROUNDS):
        for way, run in ways.items():
            found[way].append(run())
            assert found[way][-1].code == 0, found[way][-1].said
    own: tuple[list[float], list[float]] | None = None
    for way, runs in found.items():
        columns = list(zip(*((run.cpu, run.wall, run.peak) for run in runs), strict=True))
        medians, least = list(map(statistics.median, columns)), list(map(min, columns))
        line = f"{name:15} {way:14}" + "".join(f"{median:10,.1f}" for median in medians)
        for mine, theirs in zip(own or (), (medians, least), strict=False):
            ratios = [figure / other for figure, other in zip(mine, theirs, strict=True)]
            line += "  " + "".join(f"{ratio:8.2f}" for ratio in ratios)
        own = own or (medians, least)
        print(line)


def same(one: str, other: str) -> None:
    """The rows of two queries are the same, and there are some."""
    with duckdb.connect() as db:
        rows, others = (sorted(db.execute(query).fetchall()) for query in (one, other))
    assert rows == others
    assert rows


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> scale.Bench:
    made = scale.Bench(tmp_path_factory.mktemp("peers"), scale.HERE, SHARE, 2)
    made.prepare(fresh=False)
    print(f"\nshare {SHARE:g}, 2 workers, ours / theirs: medians and least of {ROUNDS} runs")
    print(f"{'':30}{'CPU s':>10}{'wall s':>10}{'MiB':>10}")
    return made


def stage(bench: scale.Bench, name: str) -> Run:
    (wanted,) = (one for one in scale.STAGES if one.name == name)

    def run() -> measured.Measured:
        for made in (bench.root / "pairs", bench.root / "state/manifests/pairs.json"):
            if name == "pairs" and made.is_dir():
                shutil.rmtree(made)
        return bench.run(wanted)

    return run


def folder(bench: scale.Bench, name: str) -> Path:
    made = bench.root.parent / name
    made.mkdir(exist_ok=True)
    return made


@pytest.mark.parametrize(
    ("source", "tables"),
    [
        (
            "youtube",
            {
                "videos": "video_id, view_count, width, height, duration_s, word_count",
                "transcripts": "video_id, kind, len(cues), len(cues[1].word_start_s)",
            },
        ),
        ("reddit", {"posts": "post_id, score", "comments": "comment_id, post_id, score"}),
    ],
)
def test_filters_and_their_peers(bench: scale.Bench, source: str, tables: dict[str, str]) -> None:
    out, raw = folder(bench, source), bench.root / "raw" / source
    peer, ours = script(f"{source}_filter.py", raw, out, 2), stage(bench, f"{source} filter")
    ours()  # the first one of a root that was never crawled also makes the state of its crawl
    beside(f"{source} filter", {"ours": ours, "DuckDB": peer})
    for name, columns in tables.items():
        clean = bench.root / "clean" / source / name
        same(
            f"SELECT {columns} FROM '{clean}/*.parquet'",
            f"SELECT {columns} FROM '{out}/{name}.parquet'",
        )


def test_pairs_and_their_peer(bench: scale.Bench) -> None:
    if not (bench.root / "clean/youtube").exists():
        stage(bench, "youtube filter")()
    profile = load_profile("minecraft")
    known, out = keywords.load(profile), folder(bench, "pairs-of-loop")
    listed = out.with_suffix(".tsv")
    with listed.open("w", encoding="utf-8") as file:
        for phrase, owner in zip(known.phrases, known.of, strict=True):
            one = None if owner == keywords.EXCLUDED else known.every[owner]
            # Where a video's topic is known, words that count by it need no other.
            reach = "" if one is None or one.rule == "topic" else one.reach or ""
            file.write(f"{phrase}\t{one.name if one else ''}\t{reach}\n")
    peer = script("pairs.py", bench.root / "clean/youtube/transcripts", listed, out, 2)
    beside("pairs", {"ours": stage(bench, "pairs"), "loop": peer})
    made = bench.root / "pairs/pairs-*.parquet"
    with duckdb.connect() as db:
        ours, theirs, both = db.execute(
            f"""WITH ours AS (SELECT DISTINCT video_id, keyword FROM '{made}'),
                theirs AS (SELECT DISTINCT video_id, keyword FROM '{out}/*.parquet')
            SELECT (SELECT count(*) FROM ours), (SELECT count(*) FROM theirs),
                (SELECT count(*) FROM ours JOIN theirs USING (video_id, keyword))"""
        ).fetchall()[0]
    # Clips may not overlap here, so that some matches give no pair; no pair is ours alone.
    assert both >= 0.999 * ours
    assert ours > 0.5 * theirs


def test_import_of_one_file_and_its_peer(tmp_path: Path) -> None:
    dump = tmp_path / "RC_2024-01.zst"
    bench_reddit_import.write(dump, LINES, bench_reddit_import.LATER)
    lines = tmp_path / "lines.zst"

    def ours(workers: int) -> Run:
        root = tmp_path / f"root{workers}"
        command = [sys.executable, "-c", "from kb.cli import main; main()", "reddit", "import"]
        command += [str(dump), "--data", str(root), "--workers", str(workers), "--quiet", "--json"]

        def run() -> measured.Measured:
            shutil.rmtree(root, ignore_errors=True)
            lines.unlink(missing_ok=True)
            found = measured.run(command, {**os.environ, "PYTHONPATH": str(scale.HERE)}, tmp_path)
            assert json.loads(found.said.splitlines()[-1])["crawled"] == len(range(7, LINES, 200))
            return found

        return run

    print(f"\nimport of one file, {LINES:,} lines")
    peer = script("import.sh", dump, lines)
    beside("import", {"two workers": ours(2), "one worker": ours(1), "zstd and grep": peer})
    with duckdb.connect() as db:
        query = f"SELECT count(*) FROM read_ndjson_objects('{lines}')"
        assert db.execute(query).fetchall()[0][0] == len(range(7, LINES, 200))
