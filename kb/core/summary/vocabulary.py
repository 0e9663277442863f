"""One noun for one number: every name of a summary (`--json`), what it counts, how a person reads
it.

The line of a command, `kb status` and the reference page are made of this table.
A name that is written `command.name` says it for that command alone.
"""

from typing import NamedTuple


class Word(NamedTuple):
    """What a name counts, and its phrase: `{n}` the number, `{counted}` what the command counts.

    Nouns stand in the plural. `always`: shown when it is nought as well. Without a phrase the name
    is for scripts only.
    """

    doc: str
    phrase: str = ""
    always: bool = False


WORDS: dict[str, Word] = {
    # The four answers, and what is in them.
    "command": Word("The command of the summary."),
    "source": Word("youtube, wiki, reddit, pairs, tasks or links."),
    "counted": Word(
        "What crawled, kept, rejected, failed and pending count: videos, pages, posts …"
    ),
    "crawled": Word(
        "Items answered in this run, `missing` ones included; for a filter all items.",
        "{n} {counted} crawled",
        always=True,
    ),
    "youtube import.crawled": Word(
        "Videos that were imported in this run.", "{n} {counted} imported", always=True
    ),
    "crawled_in_all": Word("The same over all runs on this data root.", "{n} in all"),
    "kept": Word("Items that passed every stage.", "{n} kept", always=True),
    "rejected": Word(
        "Items that a stage rejected; `stages` has each.", "{n} rejected", always=True
    ),
    "failed": Word(
        "Items that could not be read after all tries; the next run tries them again.", "{n} failed"
    ),
    "pending": Word("Known items without an answer yet.", "{n} pending"),
    "missing": Word("Crawled items that the service did not return.", "{n} of them missing"),
    "tally": Word("The four answers and `missing` for each table that has a filter."),
    "tables": Word("Kept rows by table."),
    "stages": Word("Rejected items by stage."),
    "left": Word("Items left for the next run, in all phases."),
    "left_by": Word("The same by phase."),
    "view_rules": Word("Kept videos by how their views were counted (view_rule)."),
    "word_times": Word("Kept automatic transcripts by whether they have word times, or why not."),
    "subtitles": Word("Subtitle files that were imported.", "{n} subtitle files"),
    "playlists": Word(
        "Playlists that were listed or imported; imports count channels too.", "{n} playlists"
    ),
    "playlists_left_out": Word(
        "Playlists without a row, by reason: not public, not found, not read or empty."
    ),
    "own_transcripts": Word("Own transcripts that were imported.", "{n} own transcripts"),
    "unknown_videos": Word("Own transcripts of videos that are not in the data root."),
    "youtube import.files": Word("Files that were imported in this run."),
    "known_files": Word("Files that were imported before.", "{n} files imported before"),
    "left_out_by": Word("Files that were left out, by reason."),
    "left_out_files": Word("The first files of each reason by name, with what is wrong with them."),
    "other_languages": Word(
        "Imported tracks in other languages than the profile's, by language; the filter passes them"
        " over."
    ),
    "other_language_files": Word("The first of their files by name."),
    "word_times_dropped": Word(
        "Times of words of own transcripts that are not used, as their words are not those of the"
        " text."
    ),
    "word_times_dropped_files": Word("The first of their files by name, with how many."),
    "null_columns": Word("Columns that imported files leave null, with the number of videos."),
    "duplicates": Word(
        "Older or repeated answers; only the newest one is used.", "{n} older answers"
    ),
    "unknown_keys": Word("Keys of answers that schemas/ does not declare, with their counts."),
    # What was asked and read.
    "missing_transcripts": Word(
        "Videos that pass every other stage but have no transcript.", "{n} without transcript"
    ),
    "po_token": Word(
        "Videos whose captions need a PO token; a crawl on a later day tries them again.",
        "{n} without captions, as they need a PO token",
    ),
    "requests": Word(
        "Requests sent, not counting those of the browser for a page.", "{n} requests"
    ),
    "units": Word("Quota units spent, searches included.", "{n} quota units"),
    "youtube crawl --plan.units": Word(
        "Units of the general quota; searches have a quota of their own.", "{n} quota units"
    ),
    "bad_lines": Word("Unreadable lines of an input file or dump.", "{n} bad lines"),
    "truncated_files": Word(
        "Truncated files; their complete part was read.", "{n} truncated files"
    ),
    "foreign_files": Word("Files in the given folders that are not dumps.", "{n} other files"),
    "lines": Word("Lines read from dumps.", "{n} lines searched"),
    # What `kb profile check` finds.
    "profile": Word("The profile's name."),
    "errors": Word("Problems that prevent the profile from being used.", "{n} errors", always=True),
    "warnings": Word("Settings that are probably mistakes.", "{n} warnings"),
    "notes": Word("Other remarks.", "{n} notes"),
    "findings": Word("Each of them: level, file, line, key, what is wrong and how to fix it."),
    "hits": Word("Each keyword with its kind, rule, matches and examples."),
    # What `kb index` makes and `kb search` finds.
    "passages": Word("Indexed pieces of text.", "{n} passages"),
    "indexed": Word("Sources whose index was rebuilt; the others were up to date."),
    "answers": Word(
        "Each answer: text, snippet, source, kind, key, title, path, score, url, licence, date,"
        " start_s; of a clip also pair_id, video_id, keyword, clip_start_s, clip_end_s, similarity."
    ),
    "cut_tokens": Word("Tokens of the words that are more than the model reads."),
    "search.model": Word("The model by whose vectors clips were searched."),
    # Nouns.
    "channels": Word("Channels found so far.", "{n} channels"),
    "videos": Word("Videos.", "{n} videos"),
    "playlist_videos": Word(
        "Entries of playlists, one row per video in a playlist.", "{n} entries of playlists"
    ),
    "transcripts": Word("Transcripts.", "{n} transcripts"),
    "youtube crawl.transcripts": Word("Transcripts that were found.", "{n} with transcripts"),
    "transcripts_asked": Word(
        "Videos whose transcript was asked for; some have none.", "transcripts asked for {n}"
    ),
    "pages": Word("Wiki pages.", "{n} pages"),
    "elements": Word(
        "Elements of pages, hidden ones too; the visible ones are the boxes of the report.",
        "{n} elements",
    ),
    "cells": Word("Cells of tables.", "{n} cells"),
    "images": Word("Images.", "{n} images"),
    "facts": Word("Fields of infoboxes.", "{n} facts"),
    "recipes": Word("Slots of recipes, one row per item in a slot.", "{n} slots of recipes"),
    "page_text": Word("Texts of pages, as Markdown.", "{n} texts of pages"),
    "page_links": Word("Links from page to page, by section and wording.", "{n} links of pages"),
    "categories": Word("Categories of pages.", "{n} categories"),
    "redirects": Word("Other titles of pages.", "{n} redirects"),
    "recipe_edges": Word(
        "Ingredients of recipes, a row for each outcome.", "{n} ingredients of recipes"
    ),
    "wiki crawl.images": Word("Image files fetched in all runs.", "{n} image files"),
    "images_failed": Word("Image files that could not be fetched.", "{n} image files not fetched"),
    "robots": Word("Pages that robots.txt disallows.", "{n} barred by robots.txt"),
    "gone": Word("Pages that were deleted from the wiki.", "{n} gone from the wiki"),
    "posts": Word("Posts.", "{n} posts"),
    "reddit crawl.posts": Word("Posts known so far.", "{n} posts known"),
    "comments": Word("Comments.", "{n} comments"),
    "incomplete_posts": Word(
        "Posts with comments that could not be read; the next crawl tries again.",
        "{n} incomplete posts",
    ),
    "comments_unread": Word("Comments that exist but were not read.", "{n} comments unread"),
    "reddit crawl.outside": Word(
        "Posts outside of --since and --until, left for another crawl.", "{n} outside of the dates"
    ),
    "pairs": Word("Pairs of a clip and its text.", "{n} pairs"),
    "tasks": Word("Prompts mined from titles.", "{n} tasks"),
    "open_text": Word("Transcripts released as open text.", "{n} open transcripts"),
    "uncredited": Word(
        "Creative Commons transcripts left out because title, channel or date is missing.",
        "{n} without credit left out",
    ),
    "titles": Word("Titles of kept videos.", "{n} titles"),
    "judged": Word("Tasks that people judged and did not reject.", "{n} judged by people"),
    "reworded": Word("Tasks with a better wording of people.", "{n} with their wording"),
    "starts": Word("Tasks by what says when they begin: chapter, transcript, none."),
    "clips": Word("Clips.", "{n} clips"),
    "clips.missing": Word("Pairs of videos without a file.", "{n} of videos without a file"),
    "pairs score.hours": Word("Length of these films in hours.", "{n} hours of films"),
    "pairs score.films": Word("Films that would be decoded.", "{n} films to decode", always=True),
    "clips.hours": Word("Duration of the clips in hours.", "{n} hours of clips"),
    "short": Word("Pairs whose film ends before their clip.", "{n} after the end of their film"),
    "undecodable": Word("Pairs whose film can't be decoded.", "{n} in undecodable films"),
    "film_differs": Word(
        "Pairs whose film is not as long as the video.", "{n} in films of another length"
    ),
    "unknown_length": Word(
        "Films that were taken although the length of their video is not known.",
        "{n} videos of unknown length",
    ),
    "pairs score.scored": Word("Pairs that were scored.", "{n} scored", always=True),
    "pairs score.missing": Word("Pairs of videos without a file.", "{n} of videos without a file"),
    "not_aligned": Word(
        "Pairs that `--aligned` leaves out: the film shows their text not probably enough, or"
        " nobody knows.",
        "{n} not aligned",
    ),
    "pairs align.aligned": Word("Pairs of which a time is known.", "{n} with a time"),
    "pairs align.unknown": Word(
        "Pairs of a film that was seen, of which no time is known.", "{n} without"
    ),
    "pairs align.likely": Word(
        "Pairs whose film shows their text near its words with a probability of 0.5 or more.",
        "{n} probably shown",
    ),
    "cut_texts": Word(
        "Pairs of whose text the model reads the first 77 tokens alone.", "{n} with a cut text"
    ),
    "pairs align.model": Word("The model by whose vectors pairs were aligned.", "aligned by {n}"),
    "pairs align.visible": Word(
        "What judged clips show at spoken and at aligned times: the same part of"
        " pairs/measures.json."
    ),
    "fitted": Word("The profile's two numbers as judgements fit them, and how many; or null."),
    "no_text": Word("Pairs without a text.", "{n} without a text"),
    "visible": Word(
        "What judged pairs show at each similarity: the same part of pairs/measures.json."
    ),
    "gigabytes": Word("Size of what would be written, estimated, in GB.", "about {n} GB"),
    "keywords": Word("Keywords of the list.", "{n} keywords"),
    "profile keywords.keywords": Word("Proposed rows.", "{n} rows proposed"),
    "not_proposed": Word(
        "Titles of the wiki that are unsuitable as keywords or already in the list.",
        "{n} titles left out",
    ),
    "not_proposed_by": Word("The same by reason."),
    "keywords_found": Word(
        "Keywords with a match, whether it made a pair or not.", "{n} keywords matched"
    ),
    "keywords_in_pairs": Word("Keywords that pairs are of.", "{n} keywords in them"),
    "words": Word("Words of the documents.", "{n} words"),
    "pairs.words": Word(
        "Words of the transcripts in which keywords are searched: sounds such as [Music] are none.",
        "{n} words searched",
    ),
    "matches": Word("Occurrences of keywords.", "{n} matches"),
    "ambiguous": Word("Matches of everyday words.", "{n} of everyday words"),
    "ambiguous_alone": Word(
        "Everyday words without another keyword near them; they make no pair.",
        "{n} everyday words alone",
    ),
    "excluded": Word("Matches that the keyword list excludes.", "{n} excluded"),
    "fast_videos": Word(
        "Videos with more words a second than people speak, over their length (above 5.5).",
        "{n} videos with more words than people speak",
    ),
    "outside": Word("Matches whose clip would exceed the video.", "{n} outside of the video"),
    "entities": Word("Keywords of the profile, each an entity.", "{n} entities"),
    "with_page": Word("Entities that have a page of the wiki.", "{n} with a wiki page"),
    "links": Word(
        "Places that mention an entity: parts of videos, pages, posts, comments.", "{n} links"
    ),
    "mentions": Word("Number of mentions in all places.", "{n} mentions"),
    "filled": Word("Pairs whose text was filled in.", "{n} filled"),
    "differing": Word("Pairs whose transcript has changed.", "{n} with other text"),
    "texts": Word("Distinct texts.", "{n} texts"),
    "scored": Word("Texts that were scored in this run.", "{n} scored", always=True),
    "known": Word("Texts with an existing score.", "{n} scored before"),
    "exact_again": Word(
        "Texts near the threshold that were scored again in fp32.", "{n} scored again in full"
    ),
    "fetched": Word("Files that were fetched.", "{n} files fetched", always=True),
    "pairs measure.fetched": Word(
        "Tracks that were fetched in this run.", "{n} tracks fetched", always=True
    ),
    "videos_with_both_tracks": Word(
        "Kept videos that have a manual and an automatic track.", "{n} videos with both tracks"
    ),
    "videos_compared": Word("Videos whose tracks were compared.", "{n} videos compared"),
    "speech_recognition": Word("The same section of pairs/measures.json: shares and intervals."),
    "items": Word("Items to judge.", "{n} items", always=True),
    "strata": Word("Strata of the sample.", "from {n} strata"),
    "out_of": Word("Rows that the sample stands for.", "out of {n}"),
    "label export.hours": Word(
        "Time that one person takes to judge all of them.", "about {n} hours of work"
    ),
    "label import.answers": Word("Answers in the files.", "{n} answers read", always=True),
    "added": Word("Answers that were not there before.", "{n} new"),
    "accepted_tasks": Word("Tasks that were accepted.", "{n} accepted", always=True),
    "rejected_tasks": Word("Tasks that were rejected.", "{n} rejected", always=True),
    "reworded_tasks": Word("Tasks that got a better wording.", "{n} reworded", always=True),
    "labels": Word("Answers in labels/ now.", "{n} labels in all"),
    "merge.films": Word("Files of what was seen of films that were new or grew.", "{n} of films"),
    "merge.labels": Word("Answers of people that were new.", "{n} labels"),
    "skipped": Word("Judgements that people skipped or left empty.", "{n} skipped"),
    "no_result": Word(
        "Judgements that are null or have no list of answers.", "{n} without a result"
    ),
    "no_annotations": Word(
        "Tasks whose `annotations` are missing or no list.", "{n} tasks without annotations"
    ),
    "undefined": Word(
        "Answers to other questions, with other options, or that end before they begin.",
        "{n} answers that no question has",
    ),
    "contradictory": Word(
        "Questions that one person answered differently at different times; the newest answer"
        " counts.",
        "{n} answered twice, not alike",
    ),
    "purged_items": Word("Items that were purged; their answers are refused.", "{n} purged items"),
    "unknown_items": Word(
        "Items that no table has any more; their answers are refused.", "{n} unknown items"
    ),
    "label import.figures": Word("The section labels of pairs/measures.json."),
    "present": Word("Files that were present already.", "{n} files there before"),
    "files": Word("Files.", "{n} files"),
    "tars": Word("Tar files with screenshots and images.", "{n} tars"),
    "folders": Word("Folders of a release.", "{n} folders"),
    "made": Word("Artifacts that were made.", "{n} made", always=True),
    "to_make": Word("Artifacts that would be made.", "{n} to make", always=True),
    "blocked": Word("Artifacts that can't be made yet.", "{n} that can't be made yet"),
    "artifacts": Word("The graph: artifact, inputs, recipe, command, state, reasons."),
    "obstacles": Word("What artifacts can't be made without: what, fix, artifacts."),
    "current": Word("Artifacts that were up to date.", "{n} up to date", always=True),
    "merge.folders": Word("Data roots that were read.", "{n} data roots"),
    "merge.files": Word("Files that were copied.", "{n} files", always=True),
    "merge.requests": Word("Requests of other machines that were added.", "{n} requests"),
    "rows": Word("Rows of tables.", "{n} rows"),
    "merge.scores": Word("Scores that were new.", "{n} scores"),
    "scores": Word("Scores removed because no text needs them any more.", "{n} scores"),
    "purged": Word("Named items that were removed for good.", "{n} removed for good", always=True),
    "also": Word(
        "What left with them: comments of a removed post, and what the service no longer shows.",
        "{n} more that left with them",
    ),
    "purge --plan.purged": Word("Items that a purge would remove.", "{n} to remove", always=True),
    "purge.known": Word("Items or people that were purged before.", "{n} purged before"),
    "unknown": Word("Items or people of whom nothing was ever in the data root.", "{n} never here"),
    "unread": Word("Entries of the list that name nothing.", "{n} entries unread"),
    "bytes": Word("Bytes.", "{n} bytes"),
    "files_whole": Word("Intact files.", "{n} files whole", always=True),
    "files_damaged": Word("Files with a checksum mismatch or unreadable content.", "{n} damaged"),
    "files_missing": Word("Files that are referred to but don't exist.", "{n} missing"),
    "files_foreign": Word("Files that no command writes.", "{n} foreign"),
    "kinds": Word("Files and bytes by kind and state."),
    "found": Word("Each problem: kind, state, path, size, what is wrong, advice."),
    "repaired": Word("What --repair did, and what it could not do."),
    "figures": Word("Figures of the report.", "{n} figures"),
    "deposits": Word("Deposits.", "{n} deposits"),
    "drafts": Word("Deposits that are drafts.", "{n} drafts"),
    "published": Word("Deposits that are published.", "{n} published"),
    "unchanged": Word("Deposits that were up to date.", "{n} unchanged"),
    "uploaded": Word("Files that were uploaded.", "{n} files uploaded"),
    "removed": Word("Files that the newest revision no longer holds.", "{n} files removed"),
    "repository": Word("The repository at the hub.", "in {n}"),
    "tag": Word("The tag of the newest revision.", "tagged {n}"),
    "older_revisions": Word(
        "Revisions that still hold what was removed since.",
        "{n} older revisions with what was removed since (--squash-history drops them)",
    ),
    "older_tags": Word("Tags of older revisions, which keep them.", "tags of older ones: {n}"),
    "steps": Word("Commands that the demo ran.", "{n} steps"),
    "toxicity": Word("Why there are no scores.", "toxicity {n}"),
    "model": Word("The model whose scores decided.", "scored by {n}"),
    "revision": Word("Its revision."),
    "precisions": Word("Scores by precision."),
    "unread_facts": Word(
        "Rows of infoboxes that could not be read as facts, of pages of this run.",
        "{n} rows of infoboxes not read",
    ),
    "format": Word("The layout that was written."),
    "documents": Word("Pages, threads or videos as text.", "{n} documents", always=True),
    "chunks": Word("Chunks that these were cut into.", "{n} chunks"),
    "tokens": Word("What counted as a token of a chunk.", "tokens counted as {n}"),
    "contacts": Word(
        "E-mail addresses, IP addresses and telephone numbers that placeholders replace.",
        "{n} contacts replaced",
    ),
    "path": Word("Where it was written.", "in {n}"),
    "page": Word("The report's page.", "see {n}"),
    "folder": Word("The folder with the model's files, or the one that was read.", "in {n}"),
    "release": Word("Folder of what was released.", "released in {n}"),
    "export": Word("Folder of the other layout.", "exported to {n}"),
    "root": Word("The data root of the demo.", "in {n}"),
    "without": Word("Sections of the report that have no data.", "without {n}"),
    "sandbox_model": Word("Whether scores are those of the sandbox's model.", "sandbox model: {n}"),
    "problems": Word("Why the release was refused."),
    "doctor.checks": Word("Each thing: state (ok, note, problem), what, found, fix."),
    "doctor.problems": Word("What stands in the way of a crawl.", "{n} problems", always=True),
    "sources": Word("Each source's rows, passages, links or deposit."),
    "left_out": Word("Why a step of the demo was left out.", "left out: {n}"),
    "assumed": Word("Assumptions of the plan.", "assumed: {n}"),
    "stopped": Word("Why the command stopped; the same command resumes."),
    "waits_for": Word(
        "What it waits for: quota, service or next run (exit code 3), some with the time;"
        " person, certificate, connection or disk space (exit code 4)."
    ),
    "error": Word("Why the command failed."),
    # A plan.
    "phases": Word("Phases with items, requests, units, hours and gb."),
    "hours": Word("Duration in hours, at the pace that the services require."),
    "searches": Word("Search requests.", "{n} searches"),
    "calls": Word("Requests of all kinds.", "{n} calls"),
    "transcript_hours": Word("Duration of the transcripts in hours.", "{n} hours of transcripts"),
    "gb": Word("Gigabytes of raw data.", "{n} GB"),
    "days": Word("Days at today's quotas.", "{n} days"),
    "searches_left_today": Word("Searches left in today's quota.", "{n} searches left today", True),
    "units_left_today": Word("Units left in today's quota.", "{n} units left today", True),
}


def place(name: str) -> int:
    """Where a noun stands among the others: what is sorted first, then what belongs to it."""
    return list(WORDS).index(name) if name in WORDS else len(WORDS)


def word(name: str, command: str = "") -> Word | None:
    """A name's word, that of the command or its group first; None for one that is not declared."""
    group, plan = command.partition(" ")[0], " --plan" if command.endswith("--plan") else ""
    for whose in (f"{command}.", f"{group}{plan}.", f"{group}.", ""):
        if known := WORDS.get(f"{whose}{name}"):
            return known
    return None
