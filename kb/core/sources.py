"""The sources and what is published, by the names of their folders.

A new source is a package, its schemas and its name in `CLASSES`.
"""

from kb.core.source import Source
from kb.core.source_spec import ReleaseSpec
from kb.reddit.source import Reddit
from kb.wiki.source import Wiki
from kb.youtube.source import YouTube

CLASSES: tuple[type[Source], ...] = (YouTube, Wiki, Reddit)

SOURCES = {each.name: each() for each in CLASSES}
PUBLISHED = (*SOURCES, "pairs", "tasks", "links", "open-text")

# What is made from the rows of other sources, and of which.
MADE_OF = {
    "pairs": ("youtube",),
    "tasks": ("youtube",),
    "links": tuple(SOURCES),
    "open-text": ("youtube",),
}

RELEASES: dict[str, ReleaseSpec] = {
    **{name: source.release for name, source in SOURCES.items()},
    "pairs": ReleaseSpec(
        main="pairs",
        query="SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY clips DESC"
        " LIMIT 10",
        rules=(
            *("include", "exclude", "near_words", "min_tokens", "max_tokens", "center"),
            *("min_clip_s", "max_clip_s", "min_gap_s", "max_pairs_per_video"),
        ),
        pictured="keyword",
        quality="kb.release.metadata.pair_quality:pair_quality",
        extra="pairs",
    ),
    "tasks": ReleaseSpec(
        main="tasks",
        query="SELECT prompt, start_s, end_s FROM tasks WHERE start_source <> 'none'"
        " ORDER BY prompt, video_id LIMIT 10",
        rules=("verbs", "lead_ins", "talk", "never", "max_words", "max_gap_s"),
        pictured="start_source",
        quality="kb.release.metadata.judgements:task_quality",
    ),
    "links": ReleaseSpec(
        main="links",
        query="SELECT entity, source, sum(count) AS mentions FROM links GROUP BY ALL"
        " ORDER BY mentions DESC LIMIT 10",
        section="pairs",
        rules=("include", "exclude", "near_words"),
        pictured="entity",
        scraped=True,
    ),
    "open-text": ReleaseSpec(
        main="open_text",
        query="SELECT language, count(*) AS videos, sum(word_count) AS words FROM open_text"
        " GROUP BY ALL ORDER BY words DESC",
        licence="CC-BY-3.0",
        scraped=True,
        part_of="youtube",
    ),
}

# What every release holds; the rest is there where the profile asks for it.
BY_DEFAULT = tuple(name for name in PUBLISHED if not RELEASES[name].part_of)

# Files and folders below export/ that are made from pairs and tasks; those of a source are
# its own.
EXPORTS = {
    "pairs": ("video2dataset", "minedojo/pairs.json"),
    "tasks": ("minedojo/creative_tasks.yaml",),
}


def made_of(name: str) -> tuple[str, ...]:
    """The sources whose rows are behind what is published under that name."""
    return MADE_OF.get(name, (name,))


def made_by(name: str) -> str:
    """The command that makes the tables of what is published."""
    owner = RELEASES[name].part_of or name
    return f"kb {owner} filter" if owner in SOURCES else f"kb {owner}"


def exported_by(name: str) -> str:
    """The command that makes its release folder."""
    owner = RELEASES[name].part_of or name
    return f"kb {owner} export" if owner in SOURCES else f"kb {owner}"
