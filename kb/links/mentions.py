"""A batch of texts → rows of links/links: how often each entity is named, and when first."""

from __future__ import annotations

from typing import Any, NamedTuple

import pyarrow as pa

from kb.core.installation import np
from kb.links.texts import TextPart
from kb.pairs.extract import PairCounts, matches
from kb.pairs.keywords import Keywords
from kb.pairs.matching import Matcher

MENTION = "mention"


class Finder(NamedTuple):
    """What finds keywords, made once a worker."""

    keywords: Keywords
    matcher: Matcher
    names: pa.Array[Any]


def finder(keywords: Keywords) -> Finder:
    """The automaton of a profile's keywords."""
    names = pa.array([keyword.name for keyword in keywords.every], pa.string())
    return Finder(keywords, Matcher(keywords.phrases), names)


def mentions(source: str, part: TextPart, with_: Finder) -> pa.Table:
    """Rows of a part of a source's texts, in no order that matters."""
    text = part.text
    hits = matches(text, with_, PairCounts())
    if part.timed:  # what is said when the video is over makes no pair either
        hits = hits.take(~text.beyond[text.cue_of(hits.start)])
    pair = hits.keyword * len(text) + hits.video
    order = np.argsort(pair, kind="stable")
    ordered = pair[order]
    heads = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1]))[: len(ordered)])
    counts = np.diff(np.append(heads, len(ordered)))
    first: pa.Array[Any] = pa.nulls(len(heads), pa.float64())
    if part.timed and len(heads):
        ms: np.ndarray = np.minimum.reduceat(text.time_of(hits.start[order]), heads)
        first = pa.array(ms / 1000)
    keyword, video = np.divmod(ordered[heads], max(len(text), 1))
    return rows(
        source,
        part.part,
        MENTION,
        with_.names.take(pa.array(keyword)),
        text.ids.take(pa.array(video)).cast(pa.string()),
        pa.array(counts, pa.int64()),
        first,
    )


def rows(
    source: str,
    part: str,
    how: str | pa.Array[Any],
    entities: pa.Array[Any],
    keys: pa.Array[Any],
    counts: pa.Array[Any],
    first: pa.Array[Any],
) -> pa.Table:
    """Columns of links/links; `how` for all of them or each."""
    ways = pa.array([how] * len(keys), pa.string()) if isinstance(how, str) else how
    return pa.table(
        {
            "entity": entities,
            "source": pa.array([source] * len(keys), pa.string()),
            "key": keys,
            "part": pa.array([part] * len(keys), pa.string()),
            "how": ways,
            "count": counts,
            "first_at_s": first,
        }
    )
