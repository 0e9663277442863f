"""Reads and writes pairs/measures.json: one section for each measure, each with its sample size.

The sections hold figures alone, no ids and no text. "pairs" is of all pairs. The others are of
samples, and are derived again with the pairs from what is kept: judgements, second tracks, and what
was seen of films.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from duckdb import DuckDBPyConnection

from kb.artifacts import manifest
from kb.core.errors import FatalError
from kb.core.summary import share_of
from kb.store.atomic import write_bytes
from kb.store.damage import read_note
from kb.store.layout import Layout
from kb.store.lock import taking
from kb.store.tables import database
from kb.store.tables.reading import scan

FILE = "measures.json"
PAIRS = "pairs"  # the section of all pairs
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
HALF = 0.5  # share of recurring words from which a text is mostly that


def read_measures(folder: Path) -> dict[str, Any]:
    """The sections in a folder of pairs by name; {} where nothing was measured.

    Raises DamagedData.
    """
    fix = "remove it, then run `kb pairs measure` again"
    sections: dict[str, Any] | None = read_note(folder / FILE, dict[str, Any], fix=fix)
    return sections or {}


def write_measure(root: Path, name: str, section: dict[str, Any]) -> Path:
    """Set one section, or remove it where it is empty; the others stay. Returns the file.

    Raises FatalError without pairs, WriterLocked, DamagedData, DiskFull.
    """
    with taking(root, "pairs"):
        check_pairs(root)
        before = read_measures(folder := Layout(root).pairs)
        sections = {key: kept for key, kept in before.items() if key != name}
        sections |= {name: section} if section else {}
        if sections != before:
            with manifest.editing(root, "pairs"):
                write_measures(folder, sections)
    return folder / FILE


def write_measures(folder: Path, sections: dict[str, Any]) -> Path:
    """Write all sections into a folder of pairs. Returns the file. Raises DiskFull."""
    ordered = {name: sections[name] for name in sorted(sections)}
    encoded = msgspec.json.format(msgspec.json.encode(ordered), indent=1)
    write_bytes(folder / FILE, encoded + b"\n")
    return folder / FILE


def check_pairs(root: Path) -> None:
    """Raises FatalError where no pairs were made."""
    if manifest.read_manifest(root, "pairs") is None:
        raise FatalError("there are no pairs", hint="run `kb pairs` first")


def count_pairs(root: Path, folder: Path, samples: dict[str, Any]) -> None:
    """Write the measures of a folder of pairs: figures of all of them, and those of samples.

    Raises DiskFull.
    """
    files = (sorted(folder.glob(f"{name}-*.parquet")) for name in ("pairs", "quality"))
    with database.connect(root, threads=1) as con:
        figures = pair_figures(con, *files)
    write_measures(folder, samples | {PAIRS: figures})


def pair_figures(
    con: DuckDBPyConnection, pairs: Sequence[Path], quality: Sequence[Path]
) -> dict[str, Any]:
    """What the two tables say of all pairs: the section "pairs". Shares have the form of
    `kb.core.summary.share_of`.
    """
    both = f"{scan(pairs)} JOIN {scan(quality)} USING (pair_id)"
    ends = ", ".join(f"round(quantile_cont(interpolation_error_s, {q}), 3)" for q in QUANTILES)
    n, words, copies, known, recurring, mean, verbs, asked, timed, *quantiles = (
        con.execute(f"""
        SELECT count(*), count(*) FILTER (timing = 'word'), count(duplicate_of),
            count(recurring_share), count(*) FILTER (recurring_share > {HALF}),
            round(avg(recurring_share), 4), count(*) FILTER (has_verb), count(has_verb),
            count(interpolation_error_s), {ends}
        FROM {both}""").fetchone()
        or ()
    )
    languages = con.execute(
        f"SELECT language::VARCHAR, count(*) AS n FROM {both} GROUP BY 1 ORDER BY n DESC, 1"
    ).fetchall()
    return {
        "pairs": n,
        "word_times": share_of(words, n),
        "interpolation_error_s": quantiles_of(timed, quantiles),
        "near_duplicates": share_of(copies, n),
        "recurring_text": {**share_of(recurring, known), "mean_share": mean},
        "verbs": share_of(verbs, asked),
        "languages": {code or "unknown": share_of(count, n) for code, count in languages},
    }


def quantiles_of(n: int, values: Sequence[float | None]) -> dict[str, Any]:
    """Values at `QUANTILES` as measures give them: `n`, "p05" … "p95", without values for none."""
    named = zip(QUANTILES, values, strict=True) if n else ()
    return {"n": n, **{f"p{round(100 * q):02}": value for q, value in named}}
