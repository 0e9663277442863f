"""Clips of different videos that show the same pictures, from stored vectors alone.

A clip is PARTS vectors, each the mean of an equal part of its frames, without the mean of all clips
and whitened (principal components, each divided by its deviation), so that what all films have in
common counts for nothing. Two figures of a clip are compared by their cosines:

scene     the mean of its parts
course    how each part differs from that mean: what moves, and when. A change of brightness, size
          or edges shifts all parts alike, and leaves the course as it is.

Two clips agree as much as the lower of the two cosines says. From ALONE on they are duplicates.
Where two clips or more of one video agree by SEVERAL or more with clips of another that are equally
far behind, one film has a part of the other, and all clips that are as far behind need only
CONFIRMED. A clip in which nothing moves (a black picture, a menu) has no course, and no duplicates.

Not every two clips are compared: random hyperplanes halve the clips until at most LEAF are left,
which are compared with each other; TREES times, as similar clips are parted now and then. So a
small data root is compared as a whole. Which hyperplanes depends on constants alone.

Source of the thresholds: docs/films.md, "Duplicates by picture".
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.clips.pair_rows import by_video
from kb.core.installation import np
from kb.pairs.repeated_text import joined_firsts
from kb.pairs.seeded_random import mixed
from kb.score.film_store import vectors_of
from kb.score.models import unit

CLIP = "pair_id, video_id, clip_start_s, clip_end_s"
ALONE, SEVERAL, CONFIRMED = 0.5, 0.35, 0.2
PARTS = 8
LEAST_FRAMES = 4  # of a clip; fewer have no course
LEAF, TREES = 1024, 12
_DEEPEST = 24  # hyperplanes from the root to a leaf
_WIDTH = 128  # principal components
_SHRINK, _UNSURE = 0.1, 4  # of the mean variance, added to each; more where vectors are few
_SAMPLE = 4_000  # clips of which the components are computed
_APART_S = 1.0  # by how much the distances of two clips of one copy may differ
_STILL = 1e-3  # share of the course in a clip's length below which nothing moves


class _Clips(NamedTuple):
    """Clips by video and id: `video` by number, figures float16 [clips, width] of length 1."""

    pair_id: list[str]
    video: np.ndarray
    start_s: np.ndarray
    scene: np.ndarray
    course: np.ndarray

    def agreement(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """How much each of some clips agrees with each of others: float32 [left, right]."""
        cosines = (
            figure[left].astype(np.float32) @ figure[right].astype(np.float32).T
            for figure in (self.scene, self.course)
        )
        return np.minimum(*cosines)


def visual_duplicates(root: Path, model: str, rows: pa.Table) -> dict[str, str]:
    """By the id of each pair whose clip a clip of another video agrees with: the first pair of its
    cluster, which is left out itself.

    `rows`: the columns CLIP, by video and id. Raises DamagedData.
    """
    clips = _figures(root, model, rows)
    links, agreements = _alike(clips)
    every = np.concatenate((links[agreements >= ALONE], _confirmed(clips, links)))
    first = joined_firsts(len(clips.pair_id), *every.T)
    return {
        clips.pair_id[clip]: clips.pair_id[first[clip]]
        for clip in np.flatnonzero(first != np.arange(len(first))).tolist()
    }


def _figures(root: Path, model: str, rows: pa.Table) -> _Clips:
    """Scene and course of the clips in which something moves."""
    counted = rows["video_id"].value_counts()
    videos, sizes = counted.field("values").to_pylist(), counted.field("counts").to_numpy()
    order = np.argsort(mixed(np.arange(len(videos), dtype=np.uint64)), kind="stable")
    some = [videos[place] for place in order[np.cumsum(sizes[order]) - sizes[order] < _SAMPLE]]
    sampled = rows.filter(pc.is_in(rows["video_id"], pa.array(some, pa.string())))
    every = [parts.reshape(-1, parts.shape[-1]) for _, parts in _parts(root, model, sampled)]
    if not every:
        nothing = np.zeros((0, 1), np.float16)
        return _Clips([], np.zeros(0, np.int64), np.zeros(0), nothing, nothing)
    mean, whiten = _whitening(np.concatenate(every))
    ids, video, start_s = list[str](), list[int](), list[float]()
    scenes, courses = list[np.ndarray](), list[np.ndarray]()
    number = {name: place for place, name in enumerate(videos)}
    for own, parts in _parts(root, model, rows):
        shown = (parts - mean) @ whiten
        scene = shown.mean(axis=1)
        course = (shown - scene[:, None]).reshape(len(own), -1)
        moves = np.linalg.norm(course, axis=1) > _STILL * np.linalg.norm(shown, axis=(1, 2))
        moving = [row for row, known in zip(own, moves.tolist(), strict=True) if known]
        ids += [row["pair_id"] for row in moving]
        video += [number[row["video_id"]] for row in moving]
        start_s += [row["clip_start_s"] for row in moving]
        scenes.append(unit(scene[moves]).astype(np.float16))
        courses.append(unit(course[moves]).astype(np.float16))
    figures = np.concatenate(scenes), np.concatenate(courses)
    return _Clips(ids, np.array(video, np.int64), np.array(start_s, np.float64), *figures)


def _whitening(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of vectors, and what makes principal components of them with a like deviation:
    float64 [width], [width, components].
    """
    mean = vectors.mean(axis=0)
    variances, components = np.linalg.eigh((vectors - mean).T @ (vectors - mean) / len(vectors))
    variances = np.maximum(variances[: -_WIDTH - 1 : -1], 0)
    components = components[:, : -_WIDTH - 1 : -1]
    # Which way a component points is an accident of the library, and decides about hyperplanes.
    components *= np.sign(components[np.abs(components).argmax(axis=0), range(len(variances))])
    shrink = (_SHRINK + _UNSURE * len(mean) / len(vectors)) * variances.mean()
    return mean, components / np.sqrt(variances + shrink + 1e-12)


def _parts(
    root: Path, model: str, rows: pa.Table
) -> Iterator[tuple[list[dict[str, Any]], np.ndarray]]:
    """The clips of a video that vectors are stored of, and their parts: [clips, PARTS, width]."""
    for own in by_video(rows.to_batches(1 << 14)):
        vectors = vectors_of(root, own[0]["video_id"], model)
        ticks = sorted(vectors.frames)
        middles = (np.array(ticks) + 0.5) * vectors.step_s
        ends = [(row["clip_start_s"], row["clip_end_s"]) for row in own]
        first, last = np.searchsorted(middles, np.array(ends)).T
        long = np.flatnonzero(last - first >= LEAST_FRAMES)
        if len(long):
            bounds = np.linspace(first[long], last[long], PARTS + 1, axis=1)
            low, high = np.floor(bounds[:, :-1]).astype(int), np.ceil(bounds[:, 1:]).astype(int)
            frames = unit(vectors.of_frames(ticks)).astype(np.float64)
            sums = np.concatenate((np.zeros((1, frames.shape[1])), np.cumsum(frames, axis=0)))
            parts = (sums[high] - sums[low]) / (high - low)[..., None]
            yield [own[place] for place in long.tolist()], parts


def _alike(clips: _Clips) -> tuple[np.ndarray, np.ndarray]:
    """Clips of different videos that agree by SEVERAL or more, int64 [links, 2] with the first one
    first, and how much.
    """
    links, agreements = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.float32)]
    for tree in range(TREES):
        for leaf in _leaves(clips, tree):
            agreement = clips.agreement(leaf, leaf)
            low, high = np.nonzero(agreement >= SEVERAL)
            apart = (low < high) & (clips.video[leaf[low]] != clips.video[leaf[high]])
            low, high = low[apart], high[apart]
            links.append(np.stack((leaf[low], leaf[high]), axis=1))
            agreements.append(agreement[low, high])
        if len(clips.video) <= LEAF:
            break
    every, first = np.unique(np.concatenate(links), axis=0, return_index=True)
    return every, np.concatenate(agreements)[first]


def _leaves(clips: _Clips, tree: int) -> Iterator[np.ndarray]:
    """All clips, in groups of those on the same side of hyperplanes, each in ascending order."""
    width = clips.scene.shape[1] + clips.course.shape[1]
    waiting = [(np.arange(len(clips.video)), 0)]
    while waiting:
        group, depth = waiting.pop()
        if len(group) <= LEAF or depth == _DEEPEST:
            yield from np.array_split(group, -(-len(group) // LEAF)) if len(group) else ()
            continue
        chance = np.arange(width, dtype=np.uint64) + np.uint64((tree << 40) + (depth << 32))
        plane = np.where(mixed(mixed(chance)) & np.uint64(1), 1, -1).astype(np.float32)
        scene, course = np.split(plane, [clips.scene.shape[1]])
        side = clips.scene[group] @ scene + clips.course[group] @ course
        waiting += [(group[side <= 0], depth + 1), (group[side > 0], depth + 1)]


def _confirmed(clips: _Clips, links: np.ndarray) -> np.ndarray:
    """Links of all clips of films of which one has a part of the other, as some links say."""
    video, start_s = clips.video[links], clips.start_s[links]
    behind_s = start_s[:, 1] - start_s[:, 0]
    order = np.lexsort((behind_s, video[:, 1], video[:, 0]))
    near = (video[order[1:]] == video[order[:-1]]).all(axis=1)
    near &= np.diff(behind_s[order]) <= _APART_S
    near &= (links[order[1:]] != links[order[:-1]]).all(axis=1)
    copies = {
        (*video[link].tolist(), round(float(behind_s[link]))) for link in order[:-1][near].tolist()
    }
    more = [links[:0]]
    for first, other, by_s in sorted(copies):
        left = np.arange(*np.searchsorted(clips.video, (first, first + 1)))
        right = np.arange(*np.searchsorted(clips.video, (other, other + 1)))
        apart_s = clips.start_s[right] - clips.start_s[left][:, None] - by_s
        agree = (clips.agreement(left, right) >= CONFIRMED) & (np.abs(apart_s) <= _APART_S)
        low, high = np.nonzero(agree)
        more.append(np.stack((left[low], right[high]), axis=1))
    return np.concatenate(more)
