"""Counts hits per keyword and collects examples in context, for `kb pairs keywords`."""

import heapq
from collections.abc import Iterator
from typing import NamedTuple, cast

from kb.core import signals
from kb.core.config.profile.products import Pairs
from kb.core.context import Run
from kb.core.installation import np
from kb.pairs import keywords as lists
from kb.pairs import seeded_random, transcripts
from kb.pairs.extract import PairCounts, Tools, make_tools, matches
from kb.pairs.transcript_batch import Text

_AROUND = 40  # bytes of context on each side


class KeywordLine(NamedTuple):
    """A keyword: matches, matches of an everyday word that stood alone,
    and examples `…before [phrase] after…`.
    """

    keyword: str
    kind: str
    rule: str
    matches: int
    alone: int
    examples: tuple[str, ...]


def keyword_lines(
    run: Run, examples: int = 3, kind: str = "", rare: bool = False, videos: int = 0
) -> Iterator[KeywordLine]:
    """Keywords by hits, most first. `rare`: those without a hit as well; `videos`: read that many
    transcripts, 0 for all.

    Raises ProfileError, MissingExtra, FatalError without transcripts.
    """
    tools = make_tools(run.profile.section(Pairs), run.seed, lists.load(run.profile))
    counts, shown = PairCounts(), _Examples(examples)
    left = videos or None
    total = videos or sum(map(transcripts.rows, transcripts.parts(run.root)))
    with run.progress.task("keywords", total, "transcripts") as task:
        for path in transcripts.parts(run.root):
            for text in transcripts.texts(path, 0, left):
                signals.stop.raise_if_asked()
                shown.add(text, tools, counts)
                task.advance(len(text))
                left = left - len(text) if left is not None else None
            if left == 0:
                break
    hits = {keyword.name: counts.of(number) for number, keyword in enumerate(tools.keywords.every)}
    for number, keyword in sorted(
        enumerate(tools.keywords.every),
        key=lambda item: (-hits[item[1].name].get("matches", 0), item[1].name),
    ):
        matched = hits[keyword.name].get("matches", 0)
        if (matched or rare) and kind in ("", keyword.kind):
            rule = keyword.rule if keyword.rule in ("topic", "never") else ""
            if keyword.reach is not None and not rule:
                rule = f"near:{keyword.reach}"
            yield KeywordLine(
                keyword.name,
                keyword.kind,
                rule,
                matched,
                hits[keyword.name].get("ambiguous_alone", 0),
                shown.of(number),
            )


class _Examples:
    """Of each keyword's matches those with the best drawn rank: the same in every run,
    spread over all videos.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._best: dict[int, list[tuple[int, str]]] = {}

    def add(self, text: Text, tools: Tools, counts: PairCounts) -> None:
        hits = matches(text, tools.keywords, counts)
        if not self._number or not len(hits.keyword):
            return
        ids = cast("list[str]", text.ids.to_pylist())
        keys = seeded_random.video_keys(tools.seed, ids)[hits.video]
        rank = seeded_random.bits(keys, text.characters(hits.start, hits.video), "rank")
        order = np.lexsort((rank, hits.keyword))
        sorted_ = hits.keyword[order]
        nth = np.arange(len(order)) - np.searchsorted(sorted_, sorted_)
        for hit in order[nth < self._number].tolist():
            best = self._best.setdefault(int(hits.keyword[hit]), [])
            best.append(
                (
                    int(rank[hit]),
                    _context(text, int(hits.start[hit]), int(hits.end[hit]), int(hits.video[hit])),
                )
            )
            best[:] = heapq.nsmallest(self._number, best)

    def of(self, keyword: int) -> tuple[str, ...]:
        return tuple(line for _, line in self._best.get(keyword, []))


def _context(text: Text, start: int, end: int, video: int) -> str:
    low, high = (
        max(int(text.video_at[video]), start - _AROUND),
        min(int(text.video_end[video]), end + _AROUND),
    )
    before, phrase, behind = (
        " ".join(part.decode("utf-8", "ignore").split())
        for part in (text.raw[low:start], text.raw[start:end], text.raw[end:high])
    )
    return f"{text.ids[video].as_py()}: …{before} [{phrase}] {behind}…"
