"""What is known of how good released pairs are, measured on all of them: sentences for card and
datasheet. There is no single score.
"""

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.store.tables.reading import scan

_HALF = 0.5  # share of recurring words from which a text is mostly that
_SHOWN = 5  # other languages that are named


def pair_quality(con: DuckDBPyConnection, folder: ReleaseFolder) -> tuple[str, ...]:
    """One sentence for each figure; none for a folder without pairs/quality."""
    pairs, quality = (folder.shards(name) for name in ("pairs", "quality"))
    if not pairs or not quality:
        return ()
    total, words, copies, known, recurring, mean, verbs, asked = (
        con.execute(f"""
        SELECT count(*), count(*) FILTER (timing = 'word'), count(duplicate_of),
            count(recurring_share), count(*) FILTER (recurring_share > {_HALF}),
            avg(recurring_share), count(*) FILTER (has_verb), count(has_verb)
        FROM {scan(pairs)} JOIN {scan(quality)} USING (pair_id)""").fetchone()
        or (0,) * 8
    )
    if not total:
        return ()
    lines = [
        (
            f"Times: {_share(words, total)} have match times from the times of their words"
            " (`timing = word`); for the others, words share the time of their caption evenly."
        ),
        (
            f"Near-duplicates: {_share(copies, total)} are of a video that says nearly what another"
            " one says (`duplicate_of`), by MinHash of runs of five words, 14 bands of 8 hashes."
        ),
    ]
    if known:
        lines.append(
            f"Recurring text: in {_share(recurring, known)} more than half of the words lie in runs"
            " of at least eight words that at least three videos of the channel have; on average"
            f" {mean:.1%} of the words do (`recurring_share`)."
        )
    lines.append(_languages(con, scan(quality), total))
    if asked:
        lines.append(
            f"Verbs: {_share(verbs, asked)} have a verb of a word list at most five words from the"
            " keyword (`has_verb`), a rule of thumb."
        )
    lines.append(
        "These figures come from the texts alone. Nobody looked at the videos, so they do not say"
        " whether the clip shows what the text names."
    )
    return tuple(lines)


def _languages(con: DuckDBPyConnection, rows: str, total: int) -> str:
    counts = con.execute(
        f"SELECT language::VARCHAR, count(*) AS n FROM {rows} GROUP BY 1 ORDER BY n DESC, 1"
    ).fetchall()
    (main, most), *others = [(code or "unknown", n) for code, n in counts]
    named = ", ".join(f"{code} {n:,}" for code, n in others[:_SHOWN])
    rest = f"; others: {named}" if named else ""
    return f"Languages: {_share(most, total)} have texts in `{main}` (`language`){rest}."


def _share(part: int, total: int) -> str:
    return f"{part:,} of {total:,} pairs ({part / total:.1%})"
