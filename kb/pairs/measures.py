"""What samples of the pairs' videos say of how good the pairs are.

How often speech recognition hears the profile's keywords right, and when it says they are said.

Of a sample of videos that have both tracks, the keywords of the automatic track are aligned with
those of the manual one, which people wrote: in order, by the longest runs that both have, and no
two of them further apart than `NEAR_S`. Keywords are found as for pairs, so everyday words need
another keyword near them in both tracks.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.measures import QUANTILES, quantiles_of
from kb.core.installation import np
from kb.core.summary import share_of
from kb.pairs import seeded_random, transcripts
from kb.pairs.extract import Matches, PairCounts, matches
from kb.pairs.keywords import Keywords
from kb.pairs.transcript_batch import Text
from kb.store.tables import parquet

NAME = "speech_recognition"  # section of pairs/measures.json
NEAR_S = 10.0  # how far apart the times of one spoken word may be


class VideoSample(NamedTuple):
    """Videos to compare, in the order in which they were drawn, and out of how many."""

    ids: list[str]
    out_of: int


def sampled(root: Path, both: Collection[str], n: int | None, seed: int) -> VideoSample:
    """At most `n` (None: all) of the videos `both` that are kept with a manual track.

    A larger sample of the same seed begins with the smaller one. Raises FatalError without
    transcripts, DamagedData.
    """
    ids: list[str] = []
    for path in transcripts.parts(root):
        rows = parquet.read_table(path, columns=["video_id", "kind"])
        kept = rows["video_id"].filter(pc.equal(rows["kind"].cast(pa.string()), "manual"))
        named = cast("list[str]", kept.cast(pa.string()).to_pylist())
        ids += [name for name in named if name in both]
    drawn = np.argsort(seeded_random.video_keys(seed, ids), kind="stable")[:n]
    return VideoSample([ids[place] for place in drawn.tolist()], len(ids))


class Compared(NamedTuple):
    """Keywords (numbers) of the automatic tracks, of the manual ones, and of those in both; of the
    last also the video and by how much the automatic time is later (s).
    """

    automatic: np.ndarray
    manual: np.ndarray
    both: np.ndarray
    video: np.ndarray
    later_s: np.ndarray


def compare(automatic: Text, manual: Text, keywords: Keywords) -> Compared:
    """The keywords of the two tracks of the same videos, in the same order."""
    heard, written = (matches(track, keywords, PairCounts()) for track in (automatic, manual))
    heard_s = automatic.time_of(heard.start) / 1000
    written_s = manual.time_of(written.start) / 1000
    pairs = [_aligned(heard, written, video) for video in range(len(automatic))]
    first, second = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
    near = np.abs(heard_s[first] - written_s[second]) <= NEAR_S
    first, second = first[near], second[near]
    return Compared(
        heard.keyword,
        written.keyword,
        heard.keyword[first],
        heard.video[first],
        heard_s[first] - written_s[second],
    )


def _aligned(heard: Matches, written: Matches, video: int) -> np.ndarray:
    """Places of the matches that both tracks of a video have: 2 × n."""
    (a, a_end), (b, b_end) = (
        np.searchsorted(found.video, [video, video + 1]) for found in (heard, written)
    )
    runs = SequenceMatcher(
        None, heard.keyword[a:a_end].tolist(), written.keyword[b:b_end].tolist(), autojunk=False
    ).get_matching_blocks()
    empty = np.empty((2, 0), np.int64)
    spans = [np.arange(run.size) + np.array([[a + run.a], [b + run.b]]) for run in runs]
    return np.concatenate([empty, *spans], axis=1)


class Totals:
    """Adds up what was compared, and sums it up as a section of pairs/measures.json."""

    def __init__(self, keywords: Keywords) -> None:
        self._kinds = np.array([keyword.kind for keyword in keywords.every])
        self._compared: list[Compared] = []
        self.videos = 0

    def add(self, videos: int, compared: Compared) -> None:
        """Add a batch of videos."""
        self.videos += videos
        self._compared.append(compared)

    def section(self, sample: VideoSample, seed: int) -> dict[str, Any]:
        """Figures and their sample sizes."""
        automatic, manual, both = (
            np.concatenate(
                [np.empty(0, np.int64), *(getattr(compared, name) for compared in self._compared)]
            )
            for name in ("automatic", "manual", "both")
        )
        later = np.concatenate([np.empty(0), *(compared.later_s for compared in self._compared)])

        def shares(wanted: Any) -> dict[str, Any]:
            n, written, shared = (
                int(wanted(keywords).sum()) for keywords in (automatic, manual, both)
            )
            return {
                "in_automatic": n,
                "in_manual": written,
                "in_both": shared,
                "manual_given_automatic": share_of(shared, n),
                "automatic_given_manual": share_of(shared, written),
            }

        quantiles = np.quantile(later, QUANTILES).round(3).tolist() if len(later) else ()
        kinds = sorted(set(self._kinds[np.concatenate((automatic, manual))].tolist()))
        return {
            "seed": seed,
            "videos_with_both_tracks": sample.out_of,
            "videos_sampled": len(sample.ids),
            "videos_compared": self.videos,
            "near_s": NEAR_S,
            "keywords": shares(lambda keywords: np.ones(len(keywords), bool)),
            "keywords_by_kind": {
                kind: shares(lambda keywords, kind=kind: self._kinds[keywords] == kind)
                for kind in kinds
            },
            "automatic_later_s": quantiles_of(len(later), quantiles),
        }


def measured(
    root: Path,
    second_tracks: Iterable[pa.Table],
    keywords: Keywords,
    sample: VideoSample,
    seed: int,
) -> dict[str, Any]:
    """The section of a sample whose second tracks are there. Raises DamagedData."""
    totals = Totals(keywords)
    videos = transcripts.videos(transcripts.parts(root, "videos"))
    for tracks in second_tracks:
        if not tracks.num_rows:
            continue
        ids = tracks["video_id"].combine_chunks()
        first = transcripts.of_videos(root, ids)
        order = pc.index_in(ids, value_set=first["video_id"].combine_chunks())
        known = transcripts.topic_known(videos.take(pc.index_in(ids, videos["video_id"])))
        both = (Text(tracks, known=known), Text(first.take(order), known=known))
        totals.add(len(ids), compare(*both, keywords))
    return totals.section(sample, seed)
