"""One batch of transcripts → rows of pairs/pairs, and the counts of what was found.

Every choice is drawn from (seed, video id, position of the match), so a row depends on its own
video and the profile alone.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.config.profile.products import Pairs
from kb.core.errors import MissingExtra
from kb.core.installation import install_extra, np
from kb.pairs import seeded_random
from kb.pairs.clip_tokens import ENDS, Grown, Tokens, grow
from kb.pairs.keywords import EXCLUDED, NEVER, Keywords
from kb.pairs.transcript_batch import Text


class Tools(NamedTuple):
    """What every batch needs, made once a worker."""

    section: Pairs
    seed: int
    keywords: Keywords
    tokens: Tokens


def make_tools(section: Pairs, seed: int, keywords: Keywords) -> Tools:
    """Keywords and tokenizer for a profile. Raises MissingExtra."""
    for package in ("tokenizers", "lingua", "rensa"):
        if find_spec(package) is None:
            raise MissingExtra(
                f"pairs need the package {package.replace('_', '-')}",
                hint=install_extra("pairs"),
            )
    return Tools(section, seed, keywords, Tokens())


@dataclass
class PairCounts:
    """What was found: totals, and under the same names the hits of each keyword,
    in the list's order.
    """

    totals: Counter[str] = field(default_factory=Counter)
    hits: dict[str, np.ndarray] = field(default_factory=dict)

    def add(self, other: PairCounts) -> None:
        """Add another batch's counts."""
        self.totals.update(other.totals)
        for what, hits in other.hits.items():
            self.hits[what] = self.hits[what] + hits if what in self.hits else hits

    def note(self, keywords: Keywords, what: str, which: np.ndarray) -> None:
        """Count the keywords `which` (numbers) under `what`."""
        self.totals[what] += len(which)
        self.hits[what] = np.bincount(which, minlength=len(keywords.every))

    def of(self, keyword: int) -> dict[str, int]:
        """Hits of one keyword."""
        return {what: int(hits[keyword]) for what, hits in self.hits.items() if hits[keyword]}


class Matches(NamedTuple):
    """Matches that count, in order: keyword, video,
    bytes of the phrase, its first and last word.
    """

    keyword: np.ndarray
    video: np.ndarray
    start: np.ndarray
    end: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def take(self, which: np.ndarray) -> Matches:
        return Matches(*(column[which] for column in self))


def matches(text: Text, keywords: Keywords, counts: PairCounts) -> Matches:
    """Keywords in the text, without excluded phrases and without everyday
    words that stand alone.
    """
    hits = keywords.matcher.find(text.raw)
    keyword = keywords.owner[hits.phrase]
    counts.totals["excluded"] += int((keyword == EXCLUDED).sum())
    kept = keyword != EXCLUDED
    keyword, start, end = keyword[kept], hits.start[kept], hits.end[kept]
    every = Matches(
        keyword, text.video_of(start), start, end, text.word_of(start), text.word_of(end - 1)
    )
    counts.note(keywords, "matches", keyword)
    certain, reach = keywords.certain[keyword], keywords.reach[keyword]
    meant = certain | (keywords.topical[keyword] & text.known[every.video])
    if meant.all():
        return every
    # A word that counts by the topic alone helps no other: "what the hell" may stand beside it.
    near = seeded_random.supported(every.first, every.last, every.video, certain, reach) & (
        reach != NEVER
    )
    near |= meant
    counts.note(keywords, "ambiguous", keyword[~meant])
    counts.note(keywords, "ambiguous_alone", keyword[~near])
    return every.take(near)


class PairBatch(NamedTuple):
    """The rows of a batch, in no order that matters, its counts, and all matches, chosen or not. Of
    each row: the number of its video, the bytes of the phrase and of the text, and how many
    keywords are in the text.
    """

    rows: pa.Table
    counts: PairCounts
    matches: Matches
    video: np.ndarray
    match: tuple[np.ndarray, np.ndarray]
    text: tuple[np.ndarray, np.ndarray]
    keywords: np.ndarray


def pairs_of(text: Text, tools: Tools) -> PairBatch:
    """The pairs of a batch of transcripts."""
    section, counts = tools.section, PairCounts()
    counts.totals.update(videos=len(text), words=text.word_count)
    hits = matches(text, tools.keywords, counts)
    over = text.beyond[text.cue_of(hits.start)]
    over |= text.time_of(hits.start) >= text.length[hits.video]
    if over.any():
        counts.totals["outside"] += int(over.sum())
        hits = hits.take(~over)
    position = text.characters(hits.start, hits.video)
    ids = cast("list[str]", text.ids.to_pylist())
    keys = seeded_random.video_keys(tools.seed, ids)
    rng = _Draws(keys[hits.video] if len(keys) else keys, position)
    segment = _segment(text, hits)
    grown = None
    if section.center == "grown":
        grown = _grow(text, tools, hits, rng)
        low, high = _times(text, grown.first, grown.last)
    else:
        low, high = segment
    center = rng.integers("center", low, high)
    # A step inside the limits, so that no rounding of end - start leaves them.
    shortest, longest = round(section.min_clip_s * 1000), round(section.max_clip_s * 1000)
    step = int(longest - shortest > 1)
    length = rng.integers("clip", shortest + step, longest - step)
    match = _times(text, hits.start, hits.end - 1)
    center = seeded_random.around(center, length, match)
    clip_start, clip_end = seeded_random.clips(center, length, text.length[hits.video])
    in_clip = (match[0] >= clip_start) & (match[1] <= clip_end)
    gap = round(section.min_gap_s * 1000)
    taken = np.flatnonzero(
        seeded_random.choose(
            clip_start, clip_end, hits.video, rng.bits("rank"), gap, section.max_pairs_per_video
        )
    )
    every, hits = hits, hits.take(taken)
    position, rng = position[taken], rng.take(taken)
    grown = Grown(*(column[taken] for column in grown)) if grown else _grow(text, tools, hits, rng)
    times = {
        "segment": (segment[0][taken], segment[1][taken]),
        "match": (match[0][taken], match[1][taken]),
        "text": _times(text, grown.first, grown.last),
        "clip": (clip_start[taken], clip_end[taken]),
    }
    counts.note(tools.keywords, "pairs", hits.keyword)
    words, end = _texts(text, grown)
    columns = _columns(text, tools.keywords, hits, (grown.start, end), position, rng, times)
    own = {
        "text": words,
        "token_count": grown.tokens,
        "center_s": center[taken] / 1000,
        "match_in_clip": pa.array(in_clip[taken]),
    }
    within = np.searchsorted(every.start, end) - np.searchsorted(every.start, grown.start)
    bounds = (hits.start, hits.end), (grown.start, end)
    return PairBatch(pa.table(columns | own), counts, every, hits.video, *bounds, within)


class _Draws(NamedTuple):
    """Drawn numbers of matches: keys of their videos, positions in them."""

    keys: np.ndarray
    position: np.ndarray

    def bits(self, purpose: str) -> np.ndarray:
        return seeded_random.bits(self.keys, self.position, purpose)

    def integers(self, purpose: str, low: Any, high: Any) -> np.ndarray:
        return seeded_random.integers(self.bits(purpose), low, high)

    def take(self, which: np.ndarray) -> _Draws:
        return _Draws(self.keys[which], self.position[which])


def _grow(text: Text, tools: Tools, hits: Matches, rng: _Draws) -> Grown:
    section = tools.section
    goal = rng.integers("tokens", section.min_tokens, section.max_tokens)
    return grow(
        text,
        tools.tokens,
        (hits.start, hits.end),
        hits.video,
        goal=goal,
        side=rng.integers("side", 0, goal - ENDS),
        low=section.min_tokens,
        high=section.max_tokens,
    )


def _segment(text: Text, hits: Matches) -> tuple[np.ndarray, np.ndarray]:
    """Times of the cues that hold each phrase."""
    first, last = text.cue_of(hits.start), text.cue_of(hits.end - 1)
    if not len(first):
        return first, last
    bounds = np.stack((first, last + 1), axis=1).ravel()
    return text.cue_start[first], np.maximum.reduceat(np.append(text.cue_end, 0), bounds)[::2]


def _times(text: Text, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """When the words are said that hold the bytes `first` to `last`."""
    begin = text.time_of(first)
    return begin, np.maximum(begin + 1, text.time_of(last, after=True))


def _columns(
    text: Text,
    keywords: Keywords,
    hits: Matches,
    grown: tuple[np.ndarray, np.ndarray],
    position: np.ndarray,
    rng: _Draws,
    times: dict[str, tuple[np.ndarray, np.ndarray]],
) -> dict[str, Any]:
    """Columns of the pairs; `grown`: the first byte of each text and the one after its last."""
    kinds = pa.array([keyword.kind for keyword in keywords.every])
    keyword, video = pa.array(hits.keyword), pa.array(hits.video)
    timed = text.timed(hits.start) & text.timed(hits.end - 1)
    return {
        "pair_id": seeded_random.hexadecimal(rng.bits("id")),
        "video_id": text.ids.take(video),
        "keyword": keywords.names.take(keyword),
        "keyword_kind": kinds.take(keyword),
        "match_start_char": pa.array(position),
        "match_end_char": pa.array(text.characters(hits.end, hits.video)),
        "text_start_char": pa.array(text.characters(grown[0], hits.video)),
        "text_end_char": pa.array(text.characters(grown[1], hits.video)),
        **{
            f"{what}_{side}_s": pa.array(ms / 1000)
            for what, both in times.items()
            for side, ms in zip(("start", "end"), both, strict=True)
        },
        "transcript_kind": text.kinds.take(video),
        "timing": pa.array(np.where(timed, "word", "cue")),
    }


def _texts(text: Text, grown: Grown) -> tuple[pa.Array[Any], np.ndarray]:
    """Grown texts with one space between words,
    and where they end without the white space after.
    """
    # Its stub wants exact classes.
    slices = pa.LargeListViewArray.from_arrays(  # type: ignore[call-overload]
        pa.array(grown.start), pa.array(grown.end - grown.start), pa.array(text.codes)
    )
    offsets = np.concatenate(([0], np.cumsum(grown.end - grown.start))).astype(np.int64)
    data = np.asarray(slices.flatten())
    joined = pa.LargeStringArray.from_buffers(
        len(grown.start), pa.py_buffer(offsets.data), pa.py_buffer(data.data)
    )
    trimmed = pc.ascii_rtrim(joined, " ")
    end = grown.start + np.asarray(pc.binary_length(trimmed))
    if len(data) > 1 and ((data[1:] == 0x20) & (data[:-1] == 0x20)).any():
        trimmed = pc.replace_substring_regex(pc.ascii_trim(trimmed, " "), " {2,}", " ")
    return trimmed.cast(pa.string()), end
