"""`data.video(id)`: a video, what is said in it where that is here, and what was made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from kb.core import terminal
from kb.core.errors import UsageError
from kb.reader import html
from kb.reader.tables import OpenTables, QueryResult


@dataclass(eq=False, repr=False)
class Video:
    """A row of `youtube_videos` and the rows of other tables that name it.

    video = data.video("dQw4w9WgXcQ")
    video.row["view_count"]
    video.transcript                    # None in a release alone
    video.pairs.to_pandas()             # `tasks` and `links` are such results too
    """

    row: dict[str, Any]
    transcript: list[dict[str, Any]] | None
    pairs: QueryResult
    tasks: QueryResult
    links: QueryResult

    @property
    def video_id(self) -> str:
        """YouTube's id of the video."""
        return str(self.row["video_id"])

    @property
    def title(self) -> str | None:
        """The video's title, if available."""
        return self.row.get("title")

    @property
    def url(self) -> str:
        """The video's address."""
        return f"https://www.youtube.com/watch?v={self.video_id}"

    def __repr__(self) -> str:
        return terminal.one_line(f"<video {self.video_id}: {self.title}; {self._counts()}>")

    def _counts(self) -> str:
        cues = "no transcript here"
        if self.transcript is not None:
            cues = html.count(len(self.transcript), "cue")
        made = {"pair": self.pairs, "task": self.tasks, "link": self.links}
        return ", ".join([cues, *(html.count(len(rows), name) for name, rows in made.items())])

    def _repr_html_(self) -> str:
        about = [(name, value) for name, value in self.row.items() if value is not None]
        caption = f"<b>{html.link(self.url, self.title or self.video_id)}</b>"
        return html.block(html.rows(["column", "value"], about, self._counts()), caption=caption)


def find(opened: OpenTables, video_id: str) -> Video:
    """The video of that id. Raises UsageError where there are no videos, or not this one."""
    videos = opened.ranked("youtube_videos")
    if not videos:
        raise UsageError(
            "the data contain no videos", hint="load a YouTube release or a data root with one"
        )
    rows = opened.rows(f"SELECT * FROM {videos[0].full} WHERE video_id = ?", [video_id])
    if not rows.num_rows:
        raise UsageError(
            f"unknown video {video_id!r}", hint='data["youtube_videos"] lists ids and titles'
        )
    spoken = _of_video(opened, "youtube_transcripts", video_id)
    return Video(
        row=rows.to_pylist()[0],
        transcript=spoken[0]["cues"] if len(spoken) else None,
        pairs=_of_video(opened, "pairs", video_id),
        tasks=_of_video(opened, "tasks", video_id),
        links=_of_video(opened, "links", video_id),
    )


def _of_video(opened: OpenTables, name: str, video_id: str) -> QueryResult:
    """The rows of a table that name the video; none where the table is not here."""
    for view in opened.ranked(name)[:1]:
        sql = f"SELECT * FROM {view.full} WHERE video_id = ?"
        return QueryResult(opened.rows(sql, [video_id]))
    return QueryResult(pa.table({"video_id": pa.array([], pa.string())}))
