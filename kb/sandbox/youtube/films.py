"""Films for the invented videos, in which a coloured shape stands for each keyword.

A shape is shown while its keyword is spoken and two seconds before and after, up to three at once
from left to right. Colour and shape depend on the keyword alone, so a model can learn them from
pairs. A film has a frame only where the picture changes, on a grid of half a second; it is as long
as its video.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from colorsys import hsv_to_rgb
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from kb.core.installation import np, require
from kb.pairs.keyword_list import Keyword
from kb.pairs.keywords import make_keywords
from kb.pairs.matching import WALL, Matcher
from kb.sandbox.world import World
from kb.sandbox.youtube.captions import spoken_words
from kb.sandbox.youtube.cases import Video
from kb.store.atomic import writing

if TYPE_CHECKING:
    import av

WIDTH, HEIGHT = 256, 160
RATE = 2  # changes of the picture a second, at most
AROUND_S = 2.0  # how long a shape is shown before and after its keyword is spoken
_MOST = 3  # shapes of a picture
_CELL = 80  # px; side of the square that a shape has
_GREY = 48
_GROUP = 48  # frames from one key frame to the next

Picture = tuple[str, ...]  # the keywords whose shapes are shown, from left to right


def write_films(world: World, folder: Path) -> int:
    """Write `ID.mp4` for each video, atomically, and return how many. The same world gives the same
    pixels. Raises MissingExtra, DiskFull, OSError.
    """
    require("clips", "av")
    mentions = Mentions(world)
    for video in world.youtube.videos.values():
        with writing(folder / f"{video.id}.mp4", sync=False) as path:
            write_film(path, timeline(mentions.in_video(video), video.seconds))
    return len(world.youtube.videos)


class Mentions:
    """When keywords are spoken in the videos of a world."""

    def __init__(self, world: World) -> None:
        self._catalogue = world.youtube
        domain = world.domain
        nouns = [Keyword(noun.title, "noun") for noun in domain.speech.nouns]
        self._keywords = make_keywords(list(domain.keywords) or nouns)
        self._matcher = Matcher(self._keywords.phrases)

    def in_video(self, video: Video) -> Iterator[tuple[str, float]]:
        """(keyword, start in s) of each mention in a video, in order, in the domain's language."""
        raw, places, starts = bytearray(b" "), list[int](), list[float]()
        for sentence in self._catalogue.talk(video, self._catalogue.planted.language):
            for start_s, text in spoken_words(sentence):
                places.append(len(raw))
                starts.append(start_s)
                raw += text.encode() + b" "
            raw += bytes([WALL]) + b" "
        hits = self._matcher.find(bytes(raw))
        # The last word that begins at a match or before it, as a word may have a hyphen in it.
        words = np.searchsorted(places, hits.start, "right") - 1
        for phrase, word in zip(hits.phrase.tolist(), words.tolist(), strict=True):
            keyword = self._keywords.every[self._keywords.of[phrase]]
            yield keyword.name, starts[word]


def look_of(keyword: str) -> tuple[tuple[int, int, int], int]:
    """The look of a keyword: an RGB colour (one of 24 hues, bright or dark) and the number of one
    of five shapes.
    """
    digest = hashlib.sha256(keyword.encode()).digest()
    red, green, blue = hsv_to_rgb(digest[0] % 24 / 24, 0.9, (0.6, 1.0)[digest[1] % 2])
    return (round(255 * red), round(255 * green), round(255 * blue)), digest[2] % 5


def timeline(mentions: Iterable[tuple[str, float]], seconds: int) -> Iterator[tuple[int, Picture]]:
    """Each tick (1 / RATE s) at which the picture changes, and the picture; the first tick always,
    and the last one, which ends the film.
    """
    near: defaultdict[int, dict[str, float]] = defaultdict(dict)
    last = RATE * seconds - 1
    for keyword, start_s in mentions:
        first = max(0, int((start_s - AROUND_S) * RATE))
        for tick in range(first, min(last, int((start_s + AROUND_S) * RATE)) + 1):
            distance = abs(tick / RATE - start_s)
            near[tick][keyword] = min(distance, near[tick].get(keyword, distance))
    before: Picture | None = None
    for tick in sorted({0, last} | near.keys() | {tick + 1 for tick in near if tick < last}):
        shown = near.get(tick, {})
        closest = sorted(shown, key=lambda word: (shown[word], word))[:_MOST]
        picture = tuple(sorted(closest))
        if picture != before or tick == last:
            yield tick, picture
        before = picture


def write_film(path: Path, pictures: Iterable[tuple[int, Picture]]) -> None:
    import av  # noqa: PLC0415  belongs to the extra `clips`

    base = Fraction(1, RATE)
    with av.open(str(path), "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.gop_size = _GROUP
        stream.codec_context.thread_count = 1
        stream.options = {"preset": "ultrafast"}
        for tick, picture in pictures:
            frame = _frame(picture)
            frame.pts, frame.time_base, frame.duration = tick, base, 1
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


@lru_cache(maxsize=1_000)
def _frame(picture: Picture) -> av.VideoFrame:
    import av  # noqa: PLC0415  belongs to the extra `clips`

    frame = av.VideoFrame.from_ndarray(drawn(picture), format="rgb24")
    return frame.reformat(format="yuv420p", threads=1)


def drawn(picture: Picture) -> np.ndarray:
    """A picture with the shapes of these keywords: uint8 [HEIGHT, WIDTH, 3]."""
    image = np.full((HEIGHT, WIDTH, 3), _GREY, np.uint8)
    top, left = (HEIGHT - _CELL) // 2, (WIDTH - _CELL * max(1, len(picture))) // 2
    for place, keyword in enumerate(picture):
        at = left + place * _CELL
        image[top : top + _CELL, at : at + _CELL] = _cell(keyword)
    return image


@lru_cache(maxsize=1_000)
def _cell(keyword: str) -> np.ndarray:
    """A keyword's shape in a square of _CELL px."""
    colour, shape = look_of(keyword)
    y, x = np.mgrid[-1 : 1 : _CELL * 1j, -1 : 1 : _CELL * 1j] * 1.15  # leaves a margin
    across, down, round_ = np.abs(x), np.abs(y), np.hypot(x, y)
    inside = (
        np.maximum(across, down) < 0.85,  # square
        round_ < 0.95,  # disc
        across + down < 1,  # diamond
        (np.minimum(across, down) < 0.3) & (np.maximum(across, down) < 1),  # cross
        (round_ < 0.95) & (round_ > 0.5),  # ring
    )[shape]
    return np.where(inside[..., None], np.array(colour, np.uint8), np.uint8(_GREY))
