"""The channels and videos of the invented world, as the services show them."""

from __future__ import annotations

from dataclasses import dataclass, field

from kb.sandbox.speech import Cast
from kb.sandbox.youtube.cases import Case, Track


@dataclass
class Video:
    """A video. Counts and durations are the API's text; None means that the answer leaves the field
    out.
    """

    id: str
    channel: Channel
    case: Case
    number: int
    cast: Cast  # what it is about
    title: str
    description: str
    published_at: str
    view_count: str | None
    like_count: str | None
    comment_count: str | None
    tags: list[str]
    category_id: str
    language: str  # the domain's, into which every track is translated
    label: tuple[str, str] | None  # browse id and name of what YouTube says that it is about
    seconds: int = 600
    duration: str | None = ""  # "" : made from `seconds`
    width: int = 1920
    height: int = 1080
    fps: int = 30
    sized: bool = True  # whether the API knows the embed's size
    license: str = "youtube"
    rating: str | None = None
    live: str = "none"
    in_api: bool = True
    player: str = "ok"  # ok, age, gone
    game: str | None = "topic"
    tracks: list[Track] = field(default_factory=list)
    short: bool = False
    task: str = ""  # what its title says that is done
    task_start: float | None = None  # of its chapter, in s

    @property
    def iso_duration(self) -> str | None:
        """The duration as the API writes it."""
        if self.duration != "":
            return self.duration
        minutes, seconds = divmod(self.seconds, 60)
        hours, minutes = divmod(minutes, 60)
        return (
            "PT"
            + (f"{hours}H" if hours else "")
            + (f"{minutes}M" if minutes else "")
            + (f"{seconds}S" if seconds or not minutes else "")
        )


@dataclass
class Channel:
    """A channel and its uploads, newest first. `listed` False: its uploads playlist answers 404."""

    id: str
    title: str
    description: str
    words: str
    published_at: str
    listed: bool = True
    without_shorts: bool = True  # whether a UULF… playlist exists
    videos: list[Video] = field(default_factory=list)
    entries: list[Video] = field(
        default_factory=list
    )  # as the playlist lists them: one may come twice

    @property
    def uploads(self) -> str:
        """The id of the uploads playlist."""
        return "UU" + self.id[2:]
