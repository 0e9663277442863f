"""What is known of how good released pairs are, measured on all of them or on samples: sentences
for card and datasheet. There is no single score.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from duckdb import DuckDBPyConnection

from kb.artifacts import manifest
from kb.artifacts.measures import pair_figures, read_measures
from kb.artifacts.release_folder import ReleaseFolder
from kb.core.summary import interval_text
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
    cut = con.execute(
        "SELECT count(*) FILTER (NOT match_in_clip), count(*) FROM read_parquet(?)",
        [list(map(str, pairs))],
    ).fetchall()[0]
    return (
        _times(figures["word_times"], figures["interpolation_error_s"]),
        (
            f"Phrases: of {cut[1]:,} clips {cut[1] - cut[0]:,} contain their phrase wholly; in"
            f" {cut[0]:,} it is longer than the clip (`match_in_clip` is false)."
        ),
        (
            f"Near-duplicates: {_pairs(figures['near_duplicates'])} are of a video that says nearly"
            " what another one says (`duplicate_of`), by MinHash of runs of five words, where a"
            " third of 112 hashes agree."
        ),
        *_texts(figures["recurring_text"], figures["languages"], figures["verbs"]),
        _speech_recognition(heard) if heard else _NOT_MEASURED,
        _TEXTS_ALONE,
        *_scored(samples.get("scores")),
        *_aligned(samples.get("alignment")),
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


def _texts(
    recurring: dict[str, Any], languages: dict[str, dict[str, Any]], verbs: dict[str, Any]
) -> Iterator[str]:
    """What the texts of the pairs are like."""
    if recurring["n"]:
        yield (
            f"Recurring text: in {_pairs(recurring)} more than half of the words lie in runs of at"
            " least six words that at least three videos of the channel have, and one in twenty of"
            f" them; on average {recurring['mean_share']:.1%} of the words do (`recurring_share`)."
        )
    (main, most), *others = languages.items()
    named = ", ".join(f"{code} {counts['hits']:,}" for code, counts in others[:_SHOWN])
    rest = f"; others: {named}" if named else ""
    yield f"Languages: {_pairs(most)} have texts in `{main}` (`language`){rest}."
    if verbs["n"]:
        yield (
            f"Verbs: {_pairs(verbs)} have a verb of a word list at most five words from the"
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


def _scored(section: dict[str, Any] | None) -> Iterator[str]:
    """What a model says of clips and texts, and what people's judgements say of that."""
    if not section or not section["pairs"]:
        return
    similar, moved = section["similarity"], section["further_than_2_s"]
    sentence = (
        f"Clips: {section['pairs']:,} pairs were scored on films by `{section['models'][0]}`; half"
        f" of the similarities of clip and text are between {similar['p25']:.3f} and"
        f" {similar['p75']:.3f}."
    )
    if moved["n"]:
        sentence += (
            f" In {moved['share']:.1%} the picture fits best more than two seconds before or after"
            " the words."
        )
    seen = section["visible"]
    if not seen["judged"]:
        yield sentence + (
            " Nobody has judged whether clips show what is named, so it is not known what a"
            " similarity means."
        )
        return
    bins = [part for part in seen["bins"] if part["n"]]
    sentence += (
        f" Of {seen['judged']:,} judged ones, {interval_text(bins[0])} show what is named where the"
        f" similarity is {bins[0]['to']:.3f} or less, and {interval_text(bins[-1])} where it is"
        f" {bins[-1]['from']:.3f} or more"
    )
    if area := seen["auc"]:
        sentence += f"; the area under the curve is {area['auc']:.3f}"
        sentence += f" (95 % interval {area['low']:.3f} to {area['high']:.3f})"
    if f1 := seen.get("f1"):
        sentence += (
            f"; F1 as the MineDojo paper counts it is {f1['f1']:.3f} (95 % interval"
            f" {f1['low']:.3f} to {f1['high']:.3f}, {f1['n']:,} clips), of scores above"
            f" {f1['boundary']:.3f}, the middle of two clusters"
        )
    yield sentence + "."


def _aligned(section: dict[str, Any] | None) -> Iterator[str]:
    """Whether clips at aligned times show what is named more often than at spoken ones."""
    if not section or not section["pairs"]:
        return
    likely = section["likely"]
    sentence = (
        f"Alignment: by `{section['model']}`, the films of {_pairs(likely)} probably show the text"
        " at most 20 s from its words (`alignable` is at least 0.5)."
    )
    judged = [row for row in section["visible"] if row["spoken"]["n"] or row["aligned"]["n"]]
    for row in judged:
        least = f" where `alignable` is at least {row['alignable_from']}"
        spoken, aligned = (
            f"{interval_text(row[name])} of {row[name]['n']:,} clips"
            if row[name]["n"]
            else "unknown"
            for name in ("spoken", "aligned")
        )
        sentence += (
            f" Judged clips that show what is named{least * bool(row['alignable_from'])}: at spoken"
            f" times {spoken}; at aligned times {aligned}."
        )
    if not judged:
        sentence += " Nobody has looked at these clips, so it is not known whether that is so."
    yield sentence


def task_quality(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> tuple[str, ...]:
    """What people said of tasks, and what became of it; of a root without pairs only the latter."""
    sentences = tuple(judgements(read_measures(Layout(root).pairs), "task"))
    made = manifest.read_manifest(root, "tasks")
    figures = made.figures if made is not None else {}
    if figures.get("tasks") and "from_playlists" in figures:
        listed, every = figures["from_playlists"], figures["tasks"]
        share = f"{100 * listed / every:.0f} % of {every:,} tasks"
        sentences += (f"Playlists: the videos of {listed:,} ({share}) are listed by a playlist.",)
    rejected = figures.get("rejected", {}).get("judged", 0)
    if not (figures.get("judged") or rejected):
        return sentences
    judged, every = figures["judged"] + rejected, figures["tasks"] + rejected
    curation = (
        f"Curation: people judged {judged:,} of {every:,} mined tasks. Left out, as more said"
        f" no than yes to whether it is a task, or possible: {rejected:,}; with a wording of theirs"
        f" (`prompt_mined` has the title's): {figures['reworded']:,}. Times that they gave replace"
        " the mined ones."
    )
    return (*(sentences if len(sentences) > 1 else ()), curation)


def judgements(measures: Mapping[str, Any], kind: str) -> Iterator[str]:
    """A sentence for each question about a "pair" or "task" that has an answer, or that nobody has
    judged any. `measures` are the sections of pairs/measures.json.
    """
    section = measures.get("labels", {}).get(kind)
    if not section or not section["items"]:
        yield f"Not judged yet: nobody has looked at a sample of these {kind}s."
        return
    people, items = section["annotators"], section["items"]
    who = f"{people} people" if people > 1 else "one person"
    yield (
        f"Judged by people: {who} judged {items:,} {kind}{'s' if items > 1 else ''} of a stratified"
        f" sample; the shares are those of all {kind}s."
    )
    for question in section["questions"].values():
        if question.get("n"):
            good = question["good"][0].upper() + question["good"][1:]
            judged = f"{share_text(question)}{_kappa(question['agreement'])}"
            yield f"{question['question']} {good} for {judged}."


def _kappa(agreement: dict[str, Any] | None) -> str:
    if agreement is None or agreement["kappa"] is None:
        return ""
    name = {"cohen": "Cohen's", "fleiss": "Fleiss'"}[agreement["method"]]
    return f"; {name} kappa {agreement['kappa']:.2f} over {agreement['items']:,}"


def share_text(share: Mapping[str, Any]) -> str:
    """ "95.0% (95 % interval 94.5% to 95.5%, n = 7,000)"; "none" of nothing."""
    if share["share"] is None:
        return "none"
    low, high, n = share["low"], share["high"], share["n"]
    return f"{share['share']:.1%} (95 % interval {low:.1%} to {high:.1%}, n = {n:,})"


_SPLITS = ("train", "validation", "test")


def draw_quality(root: Path, folder: ReleaseFolder) -> tuple[str, ...]:
    """How a released draw was drawn. Raises DamagedData."""
    made = manifest.read_manifest(root, f"release/{folder.name}")
    if made is None or not made.figures:
        return ()
    asked = made.figures
    condition = f", where `{asked['where']}`" if asked["where"] else ""
    splits = ", ".join(f"{split} {asked[split]:,}" for split in _SPLITS)
    drawn = f"{asked['pairs']:,} pairs were drawn from {asked['out_of']:,} released ones"
    hours = f"{asked['hours']:,} hours of {asked['videos']:,} videos"
    most = f"{asked['keywords']:,} keywords, with at most {asked['most_of_a_keyword']:,} pairs each"
    return (
        f"{drawn} with the seed {asked['seed']}{condition}. Limits: {asked['limits']}.",
        f"They are {hours}, of {most}. Splits as drawn: {splits}.",
        f"`{asked['command_again']}` draws the same rows from the same released pairs.",
    )
