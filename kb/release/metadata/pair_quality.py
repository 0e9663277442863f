"""What is known of how good released pairs are, measured on all of them or on samples: sentences
for card and datasheet. There is no single score.
"""

from pathlib import Path
from typing import Any

from duckdb import DuckDBPyConnection

from kb.artifacts.measures import read_measures
from kb.artifacts.release_folder import ReleaseFolder
from kb.store.layout import Layout
from kb.store.tables.reading import scan

_HALF = 0.5  # share of recurring words from which a text is mostly that
_SHOWN = 5  # other languages that are named


def pair_quality(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> tuple[str, ...]:
    """One sentence for each figure; none for a folder without pairs/quality. Samples are those of
    pairs/measures.json in the data root. Raises DamagedData.
    """
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
    heard = read_measures(Layout(root).pairs).get("speech_recognition")
    lines.append(_speech_recognition(heard) if heard else _NOT_MEASURED)
    lines.append(
        "These figures come from the texts alone. Nobody looked at the videos, so they do not say"
        " whether the clip shows what the text names."
    )
    return tuple(lines)


_NOT_MEASURED = (
    "Speech recognition: how often automatic transcripts get a keyword wrong was not measured."
)


def _speech_recognition(section: dict[str, Any]) -> str:
    every, later = section["keywords"], section["automatic_later_s"]
    sentence = (
        f"Speech recognition: in {section['videos_compared']:,} of"
        f" {section['videos_with_both_tracks']:,} videos that have both tracks, the manual track"
        f" has {_interval(every['manual_given_automatic'], every['in_automatic'])} of the keywords"
        " that the automatic one has, and the automatic one"
        f" {_interval(every['automatic_given_manual'], every['in_manual'])} of those that the"
        " manual one has. The intervals take every occurrence as independent, although errors of"
        " one video are alike; videos with manual captions may be spoken more clearly than others."
    )
    if later["n"]:
        sentence += (
            f" Of {later['n']:,} occurrences in both, half are in the automatic track between"
            f" {later['p25']:.2f} and {later['p75']:.2f} s later than in the manual one."
        )
    return sentence


def _interval(share: dict[str, Any], n: int) -> str:
    if share["share"] is None:
        return "none"
    low, high = share["low"], share["high"]
    return f"{share['share']:.1%} (95 % interval {low:.1%} to {high:.1%}, n = {n:,})"


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
