"""What is true of each source whatever its data: how it is collected, what it lacks, whom it concerns.

The figures around these sentences are measured (kb.release.measure). `{topic}` is the profile's title.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class About:
    """One source in sentences: for the card, the datasheet, Croissant's RAI part and the deposit."""

    title: str
    summary: str
    instance: str
    collection: str
    processing: tuple[str, ...]
    absent: str
    raw: str
    people: str
    biases: tuple[str, ...]
    limits: tuple[str, ...]
    uses: tuple[str, ...]
    avoid: tuple[str, ...]
    upkeep: str
    words: tuple[str, ...]
    tasks: tuple[str, ...]
    attribution: str

    def on(self, topic: str, text: str) -> str:
        """A sentence with the topic's name in it."""
        return text.replace("{topic}", topic)


_MODEL = "Scores of the Detoxify model are estimates: it misreads slang, quotes and game talk (mobs are killed in plain sentences)."
ABOUT = {
    "youtube": About(
        title="{topic} on YouTube: video ids and metadata",
        summary=(
            "Ids and metadata of {topic} videos on YouTube, with counts as of a stated time and toxicity scores of "
            "title and description. No video files, no transcripts."
        ),
        instance=(
            "one public video: its id, title, channel id, counts, duration, size, licence, the kind of its "
            "transcript and the time all of this was read"
        ),
        collection=(
            "Channels were found by keyword search in the YouTube Data API v3, every upload of each channel was "
            "listed and its metadata read from the same API. The kind of transcript, the game label and the largest "
            "stream's size come from the public watch page's player answer."
        ),
        processing=(
            (
                "Kept: videos whose topic is shown by YouTube's own game label, or by category and a keyword in title, tags or description."
            ),
            (
                "Dropped by stage, in order: missing, topic, views, aspect ratio, duration, age restriction, "
                "toxicity, transcript; thresholds are in the profile and each dropped row is kept apart with its "
                "value."
            ),
            (
                "Word counts are whitespace-separated words of the transcript's cues; the transcripts themselves are not released."
            ),
        ),
        absent=(
            "Like counts are null where the channel hides them, frame rates where no stream was listed, scores where the text is empty."
        ),
        raw="The service's answers stay with whoever ran the collection; ids and links lead to the originals.",
        people=(
            "Titles are written by their channels. Channel titles, descriptions, comments and names of people are "
            "not released; channel ids are, as they are public and needed for attribution."
        ),
        biases=(
            "Channels found by English keywords: other languages are under-represented.",
            "A threshold on views favours older and popular videos.",
            "Search answers favour large channels.",
        ),
        limits=(
            "Counts are of the moment in fetched_at and change daily.",
            "Videos go private or are deleted: a share of the ids stops working each year.",
            _MODEL,
        ),
        uses=(
            "finding videos to watch, caption or clip by id",
            "pre-training agents and video-language models with the pair index",
            "studies of how a game is taught on video",
        ),
        avoid=(
            "identifying, ranking or contacting channel owners",
            "re-uploading videos",
            "reading quality off view counts",
        ),
        upkeep=(
            "YouTube's terms ask that API data is read again or removed after 30 days: `kb refresh youtube` reads it "
            "again, and removed videos become tombstones."
        ),
        words=("youtube", "video", "metadata"),
        tasks=("video-classification", "text-to-video"),
        attribution=(
            "Videos and titles belong to the channels that published them, each under the licence in the column "
            "`license`. The licence below is for the compilation."
        ),
    ),
    "wiki": About(
        title="{topic} wiki: rendered pages with element boxes",
        summary=(
            "Wiki pages on {topic} as a browser shows them: full-page screenshots, text, tables, pictures and "
            "sprites, each with its box on the page, revision and licence."
        ),
        instance="one page at one revision, with its visible and hidden elements, table cells and picture files",
        collection=(
            "Every page of the main namespace was listed by the MediaWiki API and opened in a headless browser at a "
            "stated viewport. Boxes are the browser's own layout in CSS pixels of the screenshot; original picture "
            "files were fetched by their address."
        ),
        processing=(
            (
                "Dropped by stage, in order: missing, robots, render, words, toxicity; pages with too few visible words are left out."
            ),
            (
                "Tables are resolved to grid positions, nested tables are tables of their own, and header cells are marked."
            ),
            "Animations are split into frames; pictures are stored by the SHA-256 of their bytes.",
        ),
        absent=(
            "Texts are null for elements without any, heading levels for what is no heading, picture licences where the file page names none."
        ),
        raw=(
            "Rendered HTML and the extraction stay with whoever ran the collection; url and revision_id lead to the source of each page."
        ),
        people=(
            "Pages are written together by wiki editors, whom each page's contributors_url names. No user pages and no talk pages are collected."
        ),
        biases=(
            "What editors find interesting is covered in depth, the rest is short.",
            "One language edition only.",
        ),
        limits=(
            "Layout depends on the browser, its fonts and the viewport.",
            "Pages taller than the profile's limit are left out.",
            _MODEL,
        ),
        uses=(
            "document layout and visual question answering",
            "grounding game knowledge in text, tables and pictures",
            "retrieval for agents",
        ),
        avoid=(
            "presenting the text as your own: its editors are named by contributors_url",
            "commercial use where the licence forbids it",
        ),
        upkeep="`kb wiki crawl --again` reads what changed; deleted and moved pages become tombstones.",
        words=("wiki", "screenshots", "document layout", "bounding boxes"),
        tasks=("visual-question-answering", "object-detection", "question-answering"),
        attribution="Text and pictures are by the wiki's editors, whom each page's url and contributors_url name.",
    ),
    "reddit": About(
        title="{topic} on Reddit: post and comment ids with thread structure",
        summary=(
            "Ids, types, scores and thread structure of {topic} posts and comments on Reddit. No titles, no bodies, "
            "no names; a command rebuilds the content with the user's own API key."
        ),
        instance=(
            "one post (id, type, time, score, number of comments) or one comment (id, post, parent, depth, time, score)"
        ),
        collection=(
            "Posts and comments were read from monthly archive dumps and from Reddit's API with the collector's own "
            "credentials; score_source and fetched_at say which and when."
        ),
        processing=(
            (
                "Posts are dropped by stage, in order: missing, removed, nsfw, score, toxicity; comments: missing, post, removed, toxicity."
            ),
            (
                "Types follow the address that a post links to; polls count as their own type, a crosspost has its parent's."
            ),
            "Depth is counted over the whole thread; it is null where an ancestor is unknown.",
        ),
        absent=(
            "Ratios are null in old records, depth where an ancestor is unknown, fetched_at where a dump does not say when it was read."
        ),
        raw=(
            "Content stays with whoever ran the collection, with authors as keyed hashes; `kb reddit reconstruct` "
            "reads it again from the service, where deletions are honoured."
        ),
        people=(
            "No name, hash of a name, title, body or address is released. Posts and comments that were deleted or removed are left out and stay out."
        ),
        biases=(
            "Voters decide what passes the score threshold.",
            "Reddit's users are not the game's players: age, language and country are skewed.",
        ),
        limits=(
            "Scores are of the moment in fetched_at.",
            "Rebuilding needs an API key and respects the service's limits.",
            _MODEL,
        ),
        uses=(
            "studies of discussions by their structure",
            "rebuilding threads for research with one's own credentials",
        ),
        avoid=("identifying or profiling people", "rebuilding what was deleted"),
        upkeep="`kb refresh reddit` reads scores, removals and deletions again; what is gone becomes a tombstone.",
        words=("reddit", "discussion", "threads"),
        tasks=("text-generation", "text-classification"),
        attribution=(
            "Posts and comments belong to their authors. The licence below is for this index of public ids and figures."
        ),
    ),
    "pairs": About(
        title="{topic} video-text pairs: an index of clips by keyword",
        summary=(
            "Moments of {topic} videos where a keyword is spoken: the video's id, the phrase's time, the span of the "
            "text around it and the clip to cut. Text is not released; a command fills it in from the user's own "
            "transcripts."
        ),
        instance=(
            "one spoken mention of a keyword, with the time of the phrase, of the text grown around it and of the clip around its centre"
        ),
        collection=(
            "Keywords (blocks, items, entities and so on) were matched as whole words in the time-coded transcripts of the released videos."
        ),
        processing=(
            (
                "A matched segment is grown at random, with a fixed seed, to a length in CLIP tokens; a moment "
                "inside the segment is the clip's centre; the clip is grown to a length in seconds."
            ),
            "Overlapping automatic cues are read once, so that no word is doubled.",
        ),
        absent="The text column is not released.",
        raw=(
            "Transcripts stay with whoever ran the collection;"
            " `kb pairs --from-index FILE` fills the text again from one's own."
        ),
        people="The index holds ids and times only, nothing that people said.",
        biases=(
            "Common items are named far more often than rare ones.",
            "What is said is not always what is shown.",
        ),
        limits=(
            "Automatic transcripts mishear names.",
            "Times are those of cues, words inside a cue are interpolated.",
            "Videos go private or are deleted.",
        ),
        uses=("contrastive video-text training", "finding clips of a game's objects"),
        avoid=("speech or speaker recognition", "re-uploading clips"),
        upkeep="Made again after each refresh of the videos; pairs of removed videos become tombstones.",
        words=("video-text pairs", "clips", "index"),
        tasks=("text-to-video", "video-classification"),
        attribution="The videos belong to the channels that published them. The licence below is for the index.",
    ),
}
