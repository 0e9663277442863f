"""What is known of how good released pairs are, measured on all of them or on samples: sentences
for card and datasheet. There is no single score.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from duckdb import DuckDBPyConnection

from kb.artifacts.measures import pair_figures, read_measures
from kb.artifacts.release_folder import ReleaseFolder
from kb.release.metadata.judgements import judgements, share_text
from kb.store.layout import Layout

_SHOWN = 5  # other languages that are named


def pair_quality(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> tuple[str, ...]:
    """One sentence for each figure; none for a folder without pairs/quality. Samples are those of
    pairs/measures.json in the data root. Raises DamagedData.
    """
    pairs, quality = (folder.shards(name) for name in ("pairs", "quality"))
    figures = pair_figures(con, pairs, quality) if pairs and quality else {}
    if not figures.get("pairs"):
        return ()
    samples = read_measures(Layout(root).pairs)
    heard = samples.get("speech_recognition")
    return (
        _times(figures["word_times"], figures["interpolation_error_s"]),
        (
            f"Near-duplicates: {_pairs(figures['near_duplicates'])} are of a video that says nearly"
            " what another one says (`duplicate_of`), by MinHash of runs of five words, where a"
            " third of 112 hashes agree."
        ),
        *_recurring(figures["recurring_text"]),
        _languages(figures["languages"]),
        *_verbs(figures["verbs"]),
        _speech_recognition(heard) if heard else _NOT_MEASURED,
        _TEXTS_ALONE,
        *judgements(samples, "pair"),
    )


def _times(words: dict[str, Any], error: dict[str, Any]) -> str:
    sentence = (
        f"Times: {_pairs(words)} have match times from the times of their words"
        " (`timing = word`); for the others, words share the time of their caption evenly."
    )
    if error["n"]:
        sentence += (
            " Where both are known, sharing it evenly puts half of the matches between"
            f" {error['p25']:.2f} and {error['p75']:.2f} s later, and nine in ten between"
            f" {error['p05']:.2f} and {error['p95']:.2f} s (`interpolation_error_s`)."
        )
    return sentence


def _recurring(share: dict[str, Any]) -> Iterator[str]:
    if share["n"]:
        yield (
            f"Recurring text: in {_pairs(share)} more than half of the words lie in runs of at"
            " least six words that at least three videos of the channel have, and one in twenty of"
            f" them; on average {share['mean_share']:.1%} of the words do (`recurring_share`)."
        )


def _languages(languages: dict[str, dict[str, Any]]) -> str:
    (main, most), *others = languages.items()
    named = ", ".join(f"{code} {one['hits']:,}" for code, one in others[:_SHOWN])
    rest = f"; others: {named}" if named else ""
    return f"Languages: {_pairs(most)} have texts in `{main}` (`language`){rest}."


def _verbs(share: dict[str, Any]) -> Iterator[str]:
    if share["n"]:
        yield (
            f"Verbs: {_pairs(share)} have a verb of a word list at most five words from the"
            " keyword (`has_verb`), a rule of thumb."
        )


def _pairs(share: dict[str, Any]) -> str:
    return f"{share['hits']:,} of {share['n']:,} pairs ({share['share']:.1%})"


_TEXTS_ALONE = (
    "The figures above come from the texts alone, so they do not say whether the clip shows what"
    " the text names."
)
_NOT_MEASURED = (
    "Speech recognition: how often automatic transcripts get a keyword wrong was not measured."
)


def _speech_recognition(section: dict[str, Any]) -> str:
    every, later = section["keywords"], section["automatic_later_s"]
    sentence = (
        f"Speech recognition: in {section['videos_compared']:,} of"
        f" {section['videos_with_both_tracks']:,} videos that have both tracks, the manual track"
        f" has {share_text(every['manual_given_automatic'])} of the keywords"
        " that the automatic one has, and the automatic one"
        f" {share_text(every['automatic_given_manual'])} of those that the"
        " manual one has. The intervals take every occurrence as independent, although errors of"
        " one video are alike; videos with manual captions may be spoken more clearly than others."
    )
    if later["n"]:
        sentence += (
            f" Of {later['n']:,} occurrences in both, half are in the automatic track between"
            f" {later['p25']:.2f} and {later['p75']:.2f} s later than in the manual one."
        )
    return sentence
