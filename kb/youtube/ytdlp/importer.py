"""`kb youtube import`: folders of yt-dlp and one's own transcripts → raw answers. Sends nothing.

What the raw log has is not taken in again (kb.youtube.ytdlp.known_answers), so the same command
goes on after a kill and repeats nothing. Files are taken in order, a few at a time.
"""

import os
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

from kb.core import clock, signals
from kb.core.context import Run
from kb.core.errors import FatalError, KbError, LimitReached, SettingError
from kb.core.progress import Task
from kb.core.regular_file import open_regular
from kb.core.summary import Summary
from kb.crawl.file_identity import file_stamp
from kb.crawl.file_text import text_of
from kb.crawl.job import remember_import
from kb.crawl.session import CrawlSession, open_session
from kb.schema.tables import table
from kb.store.damage import SMALL
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from kb.store.state import tombstones
from kb.youtube.crawl.connector import YouTubeConnector
from kb.youtube.crawl.reduce import RAW_INFO, RAW_OWN, RAW_PLAYLISTS, RAW_SUBTITLES, VIDEOS
from kb.youtube.parse.channels import ChannelFilter
from kb.youtube.section import YouTubeSection
from kb.youtube.ytdlp import info, subtitles
from kb.youtube.ytdlp.known_answers import KnownAnswers, answer_digest
from kb.youtube.ytdlp.speech_json import heard_language
from kb.youtube.ytdlp.tracks import TrackLanguage, language_of

AT_ONCE = 256  # answers that are written and synced together
AT_ONCE_BYTES = 8 << 20
NAMED = 20  # files left out for one reason that are named
LARGEST = 100_000_000  # bytes of an info.json; one larger is not yt-dlp's. Of texts: SMALL
BROKEN_INFO, BROKEN_SUBTITLES = "broken_info", "broken_subtitles"
BROKEN_TRANSCRIPTS = "broken_transcripts"
OTHER_LANGUAGES, DROPPED = "other_languages", "word_times_dropped"
NAMELESS, FOREIGN, PURGED, UNREADABLE = "without_video_id", "other_sites", "purged", "unreadable"
# Kinds of raw answers and their names in the summary, in the order in which they are written.
_COUNTED = {
    RAW_INFO: "crawled",
    RAW_SUBTITLES: "subtitles",
    RAW_PLAYLISTS: "playlists",
    RAW_OWN: "own_transcripts",
}


def import_folders(
    run: Run, folders: Sequence[Path], own_transcripts: Sequence[Path] = ()
) -> Summary:
    """Import every info.json and subtitle file below the folders, and every transcript below those
    of one's own, that was not imported before.

    Raises SettingError when a folder is none, FatalError when nothing in them can be used,
    LimitReached and Interrupted (the same command goes on), DiskFull.
    """
    every = [*folders, *own_transcripts]
    for folder in every:
        if not folder.is_dir():
            wrote = "yt-dlp wrote to" if folder in folders else "your transcripts are in"
            raise SettingError(f"{folder} is not a folder", hint=f"name the folders that {wrote}")
    if not every:
        raise SettingError(
            "there is no folder to import",
            hint="name the folders that yt-dlp wrote to, or --own-transcripts DIR",
        )
    with open_session(run, YouTubeConnector(run), online=False) as session:
        work = _Import(run, session)
        try:
            work.read(folders, own_transcripts)
            for kind, read in ((RAW_PLAYLISTS, folders), (RAW_OWN, own_transcripts)):
                if read:
                    session.frontier.forget_lost(kind)
        except KbError as error:
            error.summary = work.summary()
            raise
        if not (work.counts["imported_files"] or work.counts["known_files"]):
            nothing = FatalError(
                f"nothing to import in {', '.join(map(str, every))}: {work.why()}",
                hint="run yt-dlp with --write-info-json --write-subs --write-auto-subs"
                if folders
                else "name each transcript by its video, such as ID.json or TITLE [ID].srt",
            )
            nothing.summary = work.summary()
            raise nothing
        remember_import(session.frontier, folders=folders, own_transcripts=own_transcripts)
        return work.summary()


class _Import:
    """One run: what is known, what waits to be written, and the counts."""

    def __init__(self, run: Run, session: CrawlSession) -> None:
        self._run, self._session = run, session
        self._known = KnownAnswers(run.root, _COUNTED)
        self._imported: defaultdict[str, set[str]] = defaultdict(set)  # ids, by the kind of answer
        self._left_out = ChannelFilter(tombstones.people(run.root, "youtube"))
        self._waiting: list[tuple[str, Envelope]] = []
        self._bytes = 0
        self.counts: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()
        self.named: defaultdict[str, list[str]] = defaultdict(list)
        self.null: Counter[str] = Counter()
        self._wanted = TrackLanguage(run.profile.section(YouTubeSection).language)
        self.other_languages: Counter[str] = Counter()

    def read(self, folders: Sequence[Path], own_transcripts: Sequence[Path]) -> None:
        """Take in every file, own transcripts last. A folder within one of the other kind is not
        read as part of that; in one that is given as both the name tells whose a file is.

        Raises what ends the run, with all that was read written.
        """
        theirs, own = ({path.resolve() for path in some} for some in (folders, own_transcripts))
        with self._run.progress.task("import", unit="files") as task:
            try:
                for folder in folders:
                    shared = folder.resolve() in own
                    for entry in info.entries_below(folder, own):
                        if not (shared and _is_own(entry)):
                            self._take(entry)
                            self._continue(task)
                self._flush(at_least=0)  # whose transcripts come next is known then
                for folder in own_transcripts:
                    shared = folder.resolve() in theirs
                    for entry in info.entries_below(folder, theirs):
                        if not shared or _is_own(entry):
                            self._take_own(entry)
                            self._continue(task)
            finally:
                self._flush(at_least=0)
                task.advance(0, videos=self.counts["crawled"])

    def _continue(self, task: Task) -> None:
        """Write what waits, when it is much. Raises Interrupted, LimitReached."""
        self._flush(at_least=AT_ONCE)
        task.advance(1, videos=self.counts["crawled"])
        signals.stop.raise_if_asked()
        if self._run.limit and self.counts["imported_files"] >= self._run.limit:
            raise LimitReached(
                f"--limit {self._run.limit} reached", hint="run the same command to resume"
            )

    def _take(self, entry: os.DirEntry[str]) -> None:
        name = entry.name
        named = info.subtitle_name(name)
        if named is not None:
            take = partial(self._subtitles, Path(entry.path), named)
            self._read(entry, name, BROKEN_SUBTITLES, SMALL, take)
        elif name.endswith(info.INFO):
            self._read(entry, name, BROKEN_INFO, LARGEST, self._info)
        elif (reason := info.left_out_as(name)) is not None:
            self._leave_out(reason, name)

    def _take_own(self, entry: os.DirEntry[str]) -> None:
        path = Path(entry.path)
        named = info.own_name(path)
        if named is not None:
            # Where the folder is the video, all files may have one name.
            name = f"{path.parent.name}/{path.name}" if path.parent.name in named.ids else path.name
            self._read(entry, name, BROKEN_TRANSCRIPTS, SMALL, partial(self._own, named))
        elif (reason := info.left_out_as(entry.name)) is not None:
            self._leave_out(reason, entry.name)

    def _read(
        self,
        entry: os.DirEntry[str],
        name: str,
        broken: str,
        most: int,
        take: Callable[[bytes, dict[str, Any], datetime], Iterable[tuple[str, Envelope]]],
    ) -> None:
        """What `take` makes of a file of at most so many bytes, unless it was imported before."""
        try:
            about = entry.stat()
            stamp = file_stamp(entry.path, about, broken)
            if self._known.has_file(stamp):
                self.counts["known_files"] += 1
                return
            with open_regular(Path(entry.path)) as opened:
                data = opened.read(most + 1)
            if len(data) > most:
                raise ValueError(f"it has more than {most:,} bytes")
            # For a reader of the raw log; never the folder, which is of this machine alone.
            changed = _time(about).isoformat()
            params = {"file": _shown(name), "bytes": about.st_size, "changed": changed}
            made = list(take(data, params, _time(about)))
        except OSError as error:
            self._leave_out(UNREADABLE, name, error.strerror or "")
        except ValueError as error:
            self._leave_out(broken, name, str(error).splitlines()[0])
        except _LeftOut as reason:
            self._leave_out(str(reason), name)
        else:
            digests = [answer_digest(kind, rawlog.encode(answer)) for kind, answer in made]
            fresh = self._known.add(stamp, digests)
            self._waiting += compress(made, fresh)
            self._bytes += len(data)
            self.counts["imported_files" if any(fresh) else "known_files"] += 1
            for kind, answer in compress(made, fresh):
                if kind in (RAW_SUBTITLES, RAW_OWN):
                    self._note_language(answer.response["language"], name)

    def _note_language(self, language: str | None, name: str) -> None:
        """Count a track that the filter will pass over, as it is in another language."""
        if language is None or self._wanted.spoken(language):
            return
        self.other_languages[language_of(language)] += 1
        if self.other_languages.total() <= NAMED:
            self.named[OTHER_LANGUAGES].append(f"{_shown(name)} ({language_of(language)})")

    def _leave_out(self, reason: str, name: str, why: str = "") -> None:
        """Count a file that is not imported, and name the first of each reason."""
        self.left_out[reason] += 1
        if self.left_out[reason] <= NAMED:
            self.named[reason].append(f"{_shown(name)} ({why})" if why else _shown(name))

    def _info(
        self, data: bytes, params: dict[str, Any], changed: datetime
    ) -> Iterator[tuple[str, Envelope]]:
        found, lists = info.read(data)
        if not (found or lists):
            raise _LeftOut(FOREIGN)
        purged = self._session.purged
        theirs = set[str]()
        for kind, records in ((RAW_INFO, found), (RAW_PLAYLISTS, lists)):
            theirs.update(*(self._left_out.theirs(kind, {}, one) for one in records))
        videos = [one for one in found if one["id"] not in purged and one["id"] not in theirs]
        playlists = [
            left[1]
            for one in lists
            if one["id"] not in purged and (left := self._left_out.without(RAW_PLAYLISTS, {}, one))
        ]
        if not (videos or playlists):
            raise _LeftOut(PURGED)
        for one in videos:
            yield RAW_INFO, _envelope(info.read_at(one) or changed, params, one)
        for one in playlists:
            one["entries"] = [each for each in one["entries"] if each["id"] not in purged]
            yield RAW_PLAYLISTS, _envelope(info.read_at(one) or changed, params, one)

    def _subtitles(
        self,
        path: Path,
        named: info.SubtitleName,
        data: bytes,
        params: dict[str, Any],
        changed: datetime,
    ) -> Iterator[tuple[str, Envelope]]:
        text, _ = _with_cues(named.format, data)
        video = None
        if named.video_id is None or self._left_out:
            video = _video_beside(path, named.stem)
        video_id = named.video_id or (video and video["id"]) or named.or_else
        if video_id is None:
            raise _LeftOut(NAMELESS)
        theirs = self._left_out.theirs(RAW_INFO, {}, video or {})
        if video_id in self._session.purged or video_id in theirs:
            raise _LeftOut(PURGED)
        answer = {
            "video_id": video_id,
            "language": named.language,
            "format": named.format,
            "text": text,
        }
        yield RAW_SUBTITLES, _envelope(changed, params, answer)

    def _own(
        self, named: info.OwnName, data: bytes, params: dict[str, Any], changed: datetime
    ) -> Iterator[tuple[str, Envelope]]:
        text, dropped = _with_cues(named.format, data)
        if not self._session.purged.isdisjoint(named.ids):
            raise _LeftOut(PURGED)
        known = (one for one in named.ids if self._session.frontier.get(VIDEOS, one))
        video_id = next(known, None)
        if video_id is None:
            video_id = named.likely
            self.counts["unknown_videos"] += video_id is not None
        if video_id is None:
            raise _LeftOut(NAMELESS)
        language = named.language
        if language is None and named.format == "json":
            language = heard_language(text)
        if dropped:
            self.counts["word_times_dropped"] += dropped
            if len(self.named[DROPPED]) < NAMED:
                self.named[DROPPED].append(f"{params['file']} ({dropped:,})")
        about = {"video_id": video_id, "language": language, "format": named.format}
        yield RAW_OWN, _envelope(changed, params, about | {"text": text})

    def _flush(self, *, at_least: int) -> None:
        """Write what waits, by kind: what is known to be read is on disk before it counts."""
        if len(self._waiting) < at_least and self._bytes < AT_ONCE_BYTES:
            return
        for kind in _COUNTED:
            made = [envelope for of, envelope in self._waiting if of == kind]
            if made:
                lines = self._session.recorder.record_all(kind, made)
                self._count(kind, made, lines)
        self._known.save()
        self._waiting, self._bytes = [], 0

    def _count(self, kind: str, made: Sequence[Envelope], lines: list[bytes]) -> None:
        """Count tracks, and videos and playlists once, however many files are of them."""
        if kind in (RAW_INFO, RAW_PLAYLISTS):
            self._imported[kind].update(answer.response["id"] for answer in made)
            self.counts[_COUNTED[kind]] = len(self._imported[kind])
        else:
            self.counts[_COUNTED[kind]] += len(lines)
        if kind != RAW_INFO:
            return
        names = [column.name for column in table("youtube/videos").columns]
        for rows in info.rows(lines):
            nulls = {name: rows[name].null_count for name in names if name in rows.column_names}
            nulls["fps"] = rows["stream_fps"].null_count
            self.null.update({name: count for name, count in nulls.items() if count})

    def why(self) -> str:
        """Why nothing could be used: the most frequent reason."""
        if not self.left_out:
            return "there is no info.json, no subtitle file and no transcript"
        reason, count = self.left_out.most_common(1)[0]
        return f"{reason.replace('_', ' ')} ({count:,} files), such as {self.named[reason][0]}"

    def summary(self) -> Summary:
        """What was imported, what was left out by reason, and which columns stay null."""
        return Summary(
            command="youtube import",
            source="youtube",
            counted="videos",
            crawled=self.counts["crawled"],
            subtitles=self.counts["subtitles"],
            playlists=self.counts["playlists"],
            own_transcripts=self.counts["own_transcripts"],
            unknown_videos=self.counts["unknown_videos"],
            files=self.counts["imported_files"],
            known_files=self.counts["known_files"],
            left_out_by=dict(self.left_out.most_common()),
            left_out_files={reason: self.named[reason] for reason in self.left_out},
            other_languages=dict(self.other_languages.most_common()),
            other_language_files=self.named[OTHER_LANGUAGES],
            word_times_dropped=self.counts["word_times_dropped"],
            word_times_dropped_files=self.named[DROPPED],
            null_columns=dict(sorted(self.null.items())),
            requests=0,
        )


class _LeftOut(Exception):
    """A file that is not imported; its text is the reason."""


def unfilled_columns(summary: Summary) -> list[str]:
    """Lines for a person: files left out by reason, and columns that files leave null."""
    lines = []
    if left_out := summary["left_out_by"]:
        counts = (f"{name.replace('_', ' ')} {n:,}" for name, n in left_out.items())
        lines.append(f"files left out: {', '.join(counts)}")
        for reason, names in summary["left_out_files"].items():
            more = left_out[reason] - len(names)
            others = f", and {more:,} more" if more else ""
            lines.append(f"  {reason.replace('_', ' ')}: {', '.join(names)}{others}")
    if others := summary["other_languages"]:
        total, names = sum(others.values()), summary["other_language_files"]
        more = f", and {total - len(names):,} more" if total > len(names) else ""
        lines.append(
            f"tracks in another language than the profile's, which the filter passes over:"
            f" {', '.join(names)}{more}"
        )
    if dropped := summary["word_times_dropped"]:
        lines.append(
            f"{dropped:,} times of words are not used, as these words are not those of their"
            f" segment's text: {', '.join(summary['word_times_dropped_files'])}"
        )
    if nulls := summary["null_columns"]:
        videos = summary["crawled"]
        every = [name for name, n in nulls.items() if n == videos]
        some = [f"{name} ({n:,})" for name, n in nulls.items() if n < videos]
        lines.append(
            f"columns that these files leave null, of {videos:,} videos:"
            f" {', '.join([*([f'{name} (all)' for name in every]), *some])}"
        )
    if unknown := summary["unknown_videos"]:
        lines.append(
            f"{unknown:,} of these transcripts are of videos that are not here; they are used once"
            " the videos are crawled or imported"
        )
    return lines


def _shown(name: str) -> str:
    """The name of a file as a text, whatever its bytes are."""
    return name.encode(errors="surrogateescape").decode(errors="replace")


def _time(about: os.stat_result) -> datetime:
    return datetime.fromtimestamp(about.st_mtime_ns // 1000 / 1e6, UTC)


def _envelope(at: datetime, params: dict[str, Any], response: Any) -> Envelope:
    return Envelope(clock.stamp(at), Request("file", params), 200, response)


def _is_own(entry: os.DirEntry[str]) -> bool:
    """Whether a file of a folder that yt-dlp wrote to is a transcript of one's own: yt-dlp's files
    of subtitles name their language.
    """
    return bool(info.own_name(Path(entry.path))) and info.subtitle_name(entry.name) is None


def _with_cues(form: str, data: bytes) -> tuple[str, int]:
    """The text of a file that has cues, and how many times of words in it are not used. Raises
    ValueError.
    """
    text = text_of(data).removeprefix("\ufeff")
    track = subtitles.read(form, text)
    if not track.cues:
        raise ValueError("no cue in it")
    return text, track.dropped


def _video_beside(path: Path, stem: str) -> dict[str, Any] | None:
    """The video in the info.json of the same name; None where there is none."""
    try:
        with open_regular(path.with_name(f"{stem}{info.INFO}")) as file:
            videos, _ = info.read(file.read(LARGEST))
    except (OSError, ValueError):
        return None
    return videos[0] if len(videos) == 1 else None
