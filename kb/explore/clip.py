"""The clip of an item that is judged: the user's own film, its frames, or the service's player."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote, urlencode

from kb.clips.clip_sources import cut, frame_times
from kb.clips.film_lookup import find_films
from kb.clips.frames import UndecodableVideo
from kb.core.errors import FatalError, UsageError
from kb.core.installation import np
from kb.explore.judge import JudgeDesk
from kb.labels.sample import described, player_address

_FRAMES, _SIZE = 6, (144, 256)


class ClipPage(NamedTuple):
    """Where the clip is. `film` is the address of the user's own file, "" where there is none;
    `why` says why not.
    """

    start_s: float
    end_s: float
    player: str
    film: str
    frames: str
    why: str


def read(desk: JudgeDesk, query: Mapping[str, str]) -> ClipPage:
    """The page of an address. Raises UsageError for times that are none."""
    video, start, end = query.get("video", ""), *_times(query)
    film, why = _look_for(desk, video)
    place = urlencode({"video": video, "start": start, "end": end})
    times = (math.floor(start), math.ceil(end)) if end else None
    part = f"#t={start:g},{end:g}" if end else ""
    return ClipPage(
        start,
        end,
        player_address(quote(video, safe=""), times),
        f"/film?{place}{part}" if film else "",
        f"/frames?{place}",
        why,
    )


def film_of(desk: JudgeDesk, video: str) -> tuple[Path | None, str]:
    """The user's own file of a video, as its page found it, since a player asks for a film in many
    parts; None and why, where there is none.
    """
    film = desk.films.get(video)
    return (film, "") if film is not None and film.is_file() else _look_for(desk, video)


def _look_for(desk: JudgeDesk, video: str) -> tuple[Path | None, str]:
    """The same, looked for in all folders."""
    desk.films.clear()
    if not desk.videos:
        return None, ""
    length = described(desk.judge.run.root, [{"video_id": video}]).get(video)
    found = find_films(desk.videos, {video: length.length_s if length else None})
    desk.films.update(found.films)
    film = found.films.get(video)
    return film, "" if film else found.reason(video)[1]


def frames_png(desk: JudgeDesk, query: Mapping[str, str]) -> bytes:
    """Frames of the clip in a row, as PNG. Raises UsageError, FatalError where there are none."""
    from PIL import Image

    start, end = _times(query)
    film, why = film_of(desk, query.get("video", ""))
    try:
        if film is not None:
            for _, images in cut(film, [frame_times(start, end, _FRAMES)], _SIZE, "pad"):
                picture = io.BytesIO()
                Image.fromarray(np.hstack(list(images))).save(picture, "png")
                return picture.getvalue()
            why = "the film has no picture for the whole clip"
    except (UndecodableVideo, FileNotFoundError) as error:
        why = str(error)
    raise FatalError(f"there are no frames: {why}")


def _times(query: Mapping[str, str]) -> tuple[float, float]:
    try:
        start, end = float(query.get("start") or 0), float(query.get("end") or 0)
    except ValueError:
        start = end = math.nan
    if not (math.isfinite(start) and math.isfinite(end) and start >= 0 and end >= 0):
        raise UsageError("the clip's times are not numbers")
    return start, end
