"""Which file is the film of a video, for everything that decodes films.

A film of a video is `ID.ext`, `TITLE [ID].ext` as yt-dlp names it, `TITLE-ID.ext` as youtube-dl
did, or a file in `ID/`; else the largest of its streams (`ID.f137.ext`). A name proves little: so a
file is taken only if it opens and lasts as long as the video, and of several the first one that
does. What lasts nearly as long can't be told from the video: a copy from which less was cut than
`tolerance_s` allows is taken.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kb.clips.frames import UndecodableVideo, check_film, decoding_error
from kb.core import signals
from kb.schema.video_facts import possible_ids, without_stream
from kb.store.walk import walk

if TYPE_CHECKING:
    import av

MISSING, FILM_DIFFERS, UNDECODABLE = "missing", "film_differs", "undecodable"
_ENDINGS = frozenset(
    (".mp4", ".m4v", ".mkv", ".webm", ".mov", ".avi", ".flv", ".ts", ".3gp", ".mpg", ".mpeg")
)
# How `yt-dlp --split-chapters` names the film of a chapter.
_CHAPTER = re.compile(r".* - [0-9]{3,} .*", re.DOTALL)
_END = 10**13  # µs; beyond the end of every film
_THREADS = 8  # that wait for disks
_DIGEST_ENDS = 1 << 20  # bytes of the beginning and the end of a film that its digest is of


class Found(NamedTuple):
    """`films`: the file of each video that has one; of `unknown` of them the video's length is not
    known, so that any length was taken. `refused`: why no file of a video was taken, by its id:
    one of the three reasons, and a sentence.
    """

    films: dict[str, Path]
    refused: dict[str, tuple[str, str]]
    unknown: int

    def reason(self, video_id: str) -> tuple[str, str]:
        """Why there is no film of a video: one of the three reasons, and a sentence."""
        return self.refused.get(video_id, (MISSING, "no file of this video"))


def find_films(folders: Iterable[Path], lengths_s: Mapping[str, float | None]) -> Found:
    """The films of videos in these folders or below them. `lengths_s`: of each video, None where it
    is not known. Raises Interrupted.
    """
    named = candidates(folders, lengths_s)
    with ThreadPoolExecutor(_THREADS, "films") as threads:
        lengths = [lengths_s[video_id] or None for video_id in named]
        chosen = threads.map(_choose, named.values(), lengths)
        verdicts = dict(zip(named, chosen, strict=True))
    films = {key: path for key, path in verdicts.items() if isinstance(path, Path)}
    refused = {key: why for key, why in verdicts.items() if not isinstance(why, Path)}
    return Found(films, refused, sum(not lengths_s[key] for key in films))


def tolerance_s(length_s: float) -> float:
    """By how much a film's length may differ from its video's."""
    return max(2.0, length_s / 100)


def candidates(folders: Iterable[Path], ids: Collection[str]) -> dict[str, list[Path]]:
    """By video id the files that bear its name: by folder and name, behind them single streams, the
    largest first.
    """
    wanted = frozenset(ids)
    whole, streams = defaultdict[str, list[Path]](list), defaultdict[str, list[Path]](list)
    for path in _films_below(folders):
        stem = without_stream(path.stem)
        named = (*possible_ids(stem), path.parent.name)
        if key := next((name for name in named if name in wanted), ""):
            (whole if stem == path.stem else streams)[key].append(path)
    for some in streams.values():
        some.sort(key=lambda path: -path.stat().st_size)
    return {key: whole[key] + streams[key] for key in sorted({*whole, *streams})}


def _films_below(folders: Iterable[Path]) -> Iterator[Path]:
    """Files that may be films. A folder that is below two of these folders is read once."""
    seen = set[Path]()
    for folder in folders:
        for where, below, others in walk(folder, strict=False):
            if (real := where.resolve()) in seen:
                below.clear()
                continue
            seen.add(real)
            # What macOS stores beside files: on other disks, and in archives.
            below[:] = [name for name in below if name != "__MACOSX"]
            for path in (where / entry.name for entry in others):
                apple = path.name.startswith("._")
                if path.suffix.lower() in _ENDINGS and not apple and path.exists():
                    yield path


def _choose(paths: list[Path], video_s: float | None) -> Path | tuple[str, str]:
    """The first of a video's files that is its film; else why the first one is not."""
    refused = dict[str, str]()
    chapters = [path for path in paths if _CHAPTER.fullmatch(path.stem)]
    for path in paths:
        signals.stop.raise_if_asked()
        if path in chapters and (video_s is None or len(chapters) > 1):
            refused.setdefault(FILM_DIFFERS, f"{path.name} is the film of a chapter")
            continue
        try:
            film_s = film_length_s(path)
        except UndecodableVideo as error:
            refused.setdefault(UNDECODABLE, str(error))
            continue
        except FileNotFoundError:
            refused.setdefault(MISSING, "the file is gone")
            continue
        if video_s is None or abs(film_s - video_s) <= tolerance_s(video_s):
            return path
        lengths = f"the film lasts {film_s:.1f} s, the video {video_s:g} s"
        refused.setdefault(FILM_DIFFERS, f"{lengths} ({path.name})")
    return min(refused.items())  # another film says more than a file that does not open


def film_digest(path: Path) -> str:
    """A digest of a film's size, beginning and end; "" where it can't be read."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            digest = hashlib.sha256(f"{size} ".encode() + file.read(_DIGEST_ENDS))
            file.seek(max(0, size - _DIGEST_ENDS))
            digest.update(file.read(_DIGEST_ENDS))
    except OSError:
        return ""
    return digest.hexdigest()[:32]


def film_length_s(path: Path) -> float:
    """From the start of a container to the end of its last picture or sound (s), whatever its
    header says: read from packets, of which nothing is decoded. Raises UndecodableVideo,
    FileNotFoundError, Interrupted.
    """
    import av  # noqa: PLC0415  belongs to the extra `clips`

    if not check_film(path).st_size:
        raise UndecodableVideo("the file is empty")
    try:
        for seeks in (True, False):
            with av.open(str(path), metadata_errors="ignore") as film:
                start = Fraction(max(film.start_time or 0, 0), av.time_base)
                end = _end(film, seeks=seeks)
                if end is not None and end > start:
                    return float(end - start)
    except (av.FFmpegError, ValueError) as error:
        raise UndecodableVideo(decoding_error(error)) from None
    raise UndecodableVideo("nothing is in the file")


def _end(film: av.container.InputContainer, *, seeks: bool) -> Fraction | None:
    """When the last picture or sound ends (s, by the container's clock); None where no packet
    could be read. With `seeks` only the last ones are read, if the file can be sought in.
    """
    import av  # noqa: PLC0415

    cover = av.stream.Disposition.attached_pic
    streams = [stream for stream in film.streams if stream.type in ("audio", "video")]
    streams = [stream for stream in streams if not stream.disposition & cover]
    if not any(stream.type == "video" for stream in streams):
        raise UndecodableVideo("no video stream")
    end: Fraction | None = None
    try:
        if seeks:
            film.seek(_END)
        for packet in film.demux(streams):
            signals.stop.raise_if_asked()
            if packet.pts is not None and packet.time_base is not None:
                shown = (packet.pts + (packet.duration or 0)) * packet.time_base
                shown += 0 if packet.duration else _step(packet.stream)
                end = shown if end is None else max(end, shown)
    except av.FFmpegError:
        pass  # the file ends too early, or can't be sought in: what came before counts
    return end


def _step(stream: av.stream.Stream) -> Fraction:
    """How long a picture is shown on average (s)."""
    rate = getattr(stream, "average_rate", None)
    return 1 / Fraction(rate) if rate else Fraction(0)
