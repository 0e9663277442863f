"""Titles and transcripts of clean/youtube → tasks/tasks-*.parquet and tasks/titles-*.parquet, after
what people said of them (labels/).

A task begins and ends at a chapter of the description, else where its subject is first spoken of.
Chapters are lines such as "1:05 Building the house", as YouTube reads them: the first one begins at
0:00, and each one later than the one before.

People reject a task when more judges answered no than yes to one of the two questions whether it is
one. Its wording is the latest of a judge who answered no to neither, and its times are the medians
of what these judges gave.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import domain_binding, freshness, manifest
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.installation import np
from kb.core.sources import made_of
from kb.core.summary import Summary
from kb.pairs import keywords
from kb.pairs.transcript_batch import Text
from kb.schema.tables import table
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import sorted_shards, write_table
from kb.tasks.titles import DUPLICATE, JUDGED, UNLISTED, TitleMiner

Times = tuple[float, float]
"""Start and end of a task in its video, in seconds."""
_ROWS = 128  # transcripts in memory at once
(_VIDEOS,) = made_of("tasks")

_CHAPTER = re.compile(r"^\W*((?:\d{1,2}:)?\d{1,2}:\d{2})\b\W*(\S.*)$", re.MULTILINE)
_SOURCES = ("chapter", "transcript", "none")  # of times
_FEWEST = 2  # chapters of a list; a single time is a remark
_GATES = ("is_task", "possible")  # questions whose no rejects


def build(run: Run) -> Summary:
    """Make the tasks, unless they are what clean/ and the profile say.

    The same input gives the same bytes. Raises ProfileError, MissingExtra, FatalError without
    videos, WriterLocked, DamagedData, DiskFull, Interrupted.
    """
    profile, rules = run.profile, run.profile.tasks
    require_videos(run)
    topics = profile.topics
    names = [one.name for one in keywords.load(profile).every] if profile.pairs else []
    with domain_binding.writing(run, "tasks"):
        if not (run.again or freshness.reasons(run, "tasks")):
            run.progress.say("tasks are up to date")
            return _summary(run.root)
        inputs, settings = manifest.inputs(run.root, "tasks"), freshness.settings(run, "tasks")
        miner = TitleMiner(rules, topics, names)
        lists = listings(run.root, miner)
        titles = _mined(run, miner, lists, only_listed=rules.from_playlists)
        times = _times(run, titles, rules.max_gap_s)
        judged = verdicts(run.root)
        with manifest.replacing(run.root, "tasks", inputs=inputs, settings=settings) as fresh:
            made = _tables(titles, times, judged, lists)
            for name, rows in made.items():
                part = fresh.folder / f".{name.partition('/')[2]}.parquet"
                write_table(part, rows, name, sync=False)
                sorted_shards([part], fresh.folder, name, released=False)
                part.unlink()
            tasks, others = made.values()
            starts = Counter(tasks["start_source"].to_pylist())
            prompts = tasks["prompt"].to_pylist(), tasks["prompt_mined"].to_pylist()
            fresh.figures = {
                "titles": len(titles),
                "tasks": tasks.num_rows,
                **{source: starts[source] for source in _SOURCES},
                "from_playlists": tasks.num_rows - tasks["playlist_id"].null_count,
                "judged": sum(tasks["judged"].to_pylist()),
                "reworded": sum(one != mined for one, mined in zip(*prompts, strict=True)),
                "rejected": dict(sorted(Counter(others["rejected_reason"].to_pylist()).items())),
            }
    return _summary(run.root)


def require_videos(run: Run) -> None:
    """Raises FatalError without videos."""
    if not manifest.rows(run.root, f"{_VIDEOS}/videos"):
        raise FatalError(
            f"there are no videos in clean/{_VIDEOS}", hint=f"run `kb {_VIDEOS} filter` first"
        )


class Listing(NamedTuple):
    """The playlist of a video: of several that lists it the first by id, those before that a phrase
    of the profile found. `teaches`: the title of one of them says that it is of tutorials.
    """

    playlist_id: str
    position: int
    teaches: bool


def listings(root: Path, miner: TitleMiner) -> dict[str, Listing]:
    """By video. Raises DamagedData."""
    files = [manifest.rows(root, f"{_VIDEOS}/{name}") for name in ("playlists", "playlist_videos")]
    if not all(files):
        return {}
    parquet.verify_files(*files[0], *files[1])
    with database.over([*files[0], *files[1]], root) as con:
        rows = con.execute(
            f"""SELECT video_id, playlist_id, position, title FROM {scan(files[0])} AS lists
            JOIN {scan(files[1])} AS entries USING (playlist_id)
            ORDER BY video_id, keyword IS NULL, playlist_id"""
        ).fetchall()
    found: dict[str, Listing] = {}
    for video, playlist, position, title in rows:
        first = found.setdefault(video, Listing(playlist, position, teaches=False))
        if miner.teaches(title or ""):
            found[video] = first._replace(teaches=True)
    return found


class _Title(msgspec.Struct):
    """A title of a kept video, and what was made of it."""

    video_id: str
    published: str
    length_s: float | None
    prompt: str
    object: tuple[str, ...]
    reasons: tuple[str, ...]
    chapter: Times | None

    @property
    def task_id(self) -> str:
        return hashlib.sha256(f"{self.video_id}\n{self.prompt}".encode()).hexdigest()[:16]


def _mined(
    run: Run, miner: TitleMiner, lists: Mapping[str, Listing], *, only_listed: bool
) -> list[_Title]:
    """Every title, sorted by video. Of videos with the same prompt the first published one has it.
    With `only_listed` a video that no playlist lists gives none.

    Python reads one title after another: a title is a line, and its words are cut and compared.
    """
    files = manifest.rows(run.root, f"{_VIDEOS}/videos")
    columns = ["video_id", "title", "description", "duration_s", "published_at"]
    titles = []
    with run.progress.task("titles", total=len(files), unit="files") as task, reading(files):
        for path in files:
            with parquet.open_file(path) as file:
                for batch in file.iter_batches(columns=columns):
                    signals.stop.raise_if_asked()
                    rows = batch.to_pydict()
                    rows["published_at"] = pc.cast(batch["published_at"], pa.string()).to_pylist()
                    cells = zip(*(rows[name] for name in columns), strict=True)
                    titles += [_title(miner, lists.get(str(row[0])), *row) for row in cells]
            task.advance()
    for one in titles if only_listed else ():
        if one.video_id not in lists:
            one.reasons = (UNLISTED, *one.reasons)
    titles.sort(key=lambda one: (one.published, one.video_id))
    taken: set[str] = set()
    for one in titles:
        if not one.reasons and (plain := miner.plain(one.prompt)) in taken:
            one.reasons = (DUPLICATE,)
        elif not one.reasons:
            taken.add(plain)
    return sorted(titles, key=lambda one: one.video_id)


def _title(
    miner: TitleMiner,
    listing: Listing | None,
    video_id: str,
    title: str | None,
    description: str | None,
    length_s: float | None,
    published: str | None,
) -> _Title:
    mined = miner.mine(title or "", taught=listing is not None and listing.teaches)
    chapter = None
    if not mined.reasons:
        chapter = by_chapter(chapters(description or "", length_s), mined.object, length_s)
    return _Title(video_id, published or "", length_s, *mined, chapter)


def _times(run: Run, titles: list[_Title], max_gap_s: float) -> dict[str, Times]:
    """By video: the times that transcripts say, of tasks without a chapter."""
    wanted = {one.video_id: one for one in titles if not one.reasons and one.chapter is None}
    ids = pa.array(sorted(wanted), pa.string())
    files = manifest.rows(run.root, f"{_VIDEOS}/transcripts") if wanted else []
    times: dict[str, Times] = {}
    with run.progress.task("transcripts", total=len(files), unit="files") as task, reading(files):
        for path in files:
            with parquet.open_file(path, pre_buffer=False) as file:
                columns = ["video_id", "kind", "cues"]
                for batch in file.iter_batches(batch_size=_ROWS, columns=columns):
                    signals.stop.raise_if_asked()
                    rows = batch.filter(pc.is_in(batch.column("video_id"), value_set=ids))
                    if not rows.num_rows:
                        continue
                    mine = [wanted[str(key)] for key in rows.column("video_id").to_pylist()]
                    lengths = pa.array([one.length_s for one in mine], pa.float64())
                    text = Text(pa.Table.from_batches([rows]), lengths)
                    mentioned = by_mentions(text, [one.object for one in mine], max_gap_s)
                    times |= {
                        one.video_id: at for one, at in zip(mine, mentioned, strict=True) if at
                    }
            task.advance()
    return times


def _tables(
    titles: list[_Title],
    times: dict[str, Times],
    judged: Mapping[str, Verdict],
    lists: Mapping[str, Listing],
) -> dict[str, pa.Table]:
    """Rows of tasks and titles, after what people said of them."""
    rows: dict[str, list[dict[str, Any]]] = {"tasks/tasks": [], "tasks/titles": []}
    for one in titles:
        at, listing = one.chapter or times.get(one.video_id), lists.get(one.video_id)
        source = "none" if at is None else "chapter" if one.chapter else "transcript"
        mined = start, end = at or (None, None)
        verdict, prompt, reasons = judged.get(one.video_id), one.prompt, one.reasons
        if verdict is not None and verdict.rejected:
            reasons = reasons or (JUDGED,)
        elif verdict is not None:
            # A wording is a task also where the title alone gives none.
            prompt, reasons = verdict.wording or prompt, () if verdict.wording else reasons
            start, end = verdict.times(start, end, one.length_s)
        rows["tasks/titles" if reasons else "tasks/tasks"].append(
            {
                "task_id": one.task_id,
                "prompt": prompt or None,
                "video_id": one.video_id,
                "playlist_id": listing and listing.playlist_id,
                "playlist_position": listing and listing.position,
                "start_s": start,
                "end_s": end,
                "start_source": source,
                "collection": _VIDEOS,
                "reasons": reasons,
                "rejected_reason": reasons[0] if reasons else None,
                "judged": verdict is not None,
                "n_judges": verdict.judges if verdict else 0,
                "prompt_mined": one.prompt or None,
                "start_mined_s": mined[0],
                "end_mined_s": mined[1],
            }
        )
    return {name: pa.Table.from_pylist(made, table(name).arrow()) for name, made in rows.items()}


def _summary(root: Path) -> Summary:
    made = manifest.read_manifest(root, "tasks")
    figures = made.figures if made is not None else {}
    starts = {name: figures[name] for name in _SOURCES}
    return Summary(
        {"command": "tasks", "source": "tasks"},
        **{
            name: figures[name]
            for name in ("tasks", "titles", "from_playlists", "judged", "reworded")
        },
        starts=starts,
        rejected_by=figures["rejected"],
        path=str(Layout(root).tasks),
    )


def chapters(description: str, length_s: float | None) -> list[tuple[float, str]]:
    """The start (s) and title of each chapter; [] where the lines are not a list of chapters."""
    listed: list[tuple[float, str]] = []
    for time, title in _CHAPTER.findall(description):
        seconds = 0
        for part in time.split(":"):
            seconds = seconds * 60 + int(part)
        listed.append((float(seconds), title))
    rising = all(one < other for (one, _), (other, _) in pairwise(listed))
    if len(listed) < _FEWEST or listed[0][0] != 0 or not rising:
        return []
    return [one for one in listed if length_s is None or one[0] < length_s]


def by_chapter(
    listed: Sequence[tuple[float, str]], words: Sequence[str], length_s: float | None
) -> Times | None:
    """The times of the first chapter whose title names the object."""
    for named in _suffixes(words):
        for number, (start, title) in enumerate(listed):
            if named.search(title.encode()):
                following = listed[number + 1 :]
                end = following[0][0] if following else length_s
                return (start, end) if end is not None else None
    return None


def by_mentions(
    text: Text, objects: Sequence[Sequence[str]], max_gap_s: float
) -> list[Times | None]:
    """The times in which each transcript of a batch speaks of its object; None where it does not.

    Mentions at most `max_gap_s` apart belong together. The task begins with the first of those that
    have company, as a single mention is a greeting or an announcement, and ends with the cue of the
    last. Where all stand alone, it is the first one's cue from the mention on.
    """
    return [
        _mentioned(text, number, words, max_gap_s * 1000) for number, words in enumerate(objects)
    ]


def _mentioned(text: Text, number: int, words: Sequence[str], max_gap: float) -> Times | None:
    begin, end = int(text.video_at[number]), int(text.video_end[number])
    for named in _suffixes(words):
        places = np.array([one.start() for one in named.finditer(text.raw, begin, end)], np.int64)
        if len(places):
            break
    else:
        return None
    starts = text.time_of(places)
    parted = np.flatnonzero(np.diff(starts) > max_gap) + 1
    groups = np.split(np.arange(len(places)), parted)
    group = next((one for one in groups if len(one) > 1), groups[0])
    last = int(text.cue_end[text.cue_of(places[group[-1:]])][0])
    start = int(starts[group[0]])
    return start / 1000, max(last, start) / 1000


def _suffixes(words: Sequence[str]) -> list[re.Pattern[bytes]]:
    """Patterns of the object's words, whole, then without the first ones: of "simple wooden house"
    a transcript may have "wooden house" or "house".
    """
    every = [rb"\W+".join(re.escape(one.encode()) for one in words[n:]) for n in range(len(words))]
    return [re.compile(rb"(?<!\w)" + one + rb"(?:e?s)?(?!\w)", re.IGNORECASE) for one in every]


class Verdict(NamedTuple):
    """What the judges of a video's task say together; `wording`: "" where none is given."""

    judges: int
    rejected: bool
    wording: str
    begins_s: float | None
    ends_s: float | None

    def times(
        self, start: float | None, end: float | None, length_s: float | None
    ) -> tuple[float | None, float | None]:
        """The times in place of the mined ones. Where only one is given and the other does not fit
        it, the task reaches to that side's end of the video; times that contradict each other
        change nothing.
        """
        begins, ends = self.begins_s, self.ends_s
        if begins is None and ends is None:
            return start, end
        if begins is None:
            begins = start if start is not None and start < (ends or 0) else 0.0
        if ends is None:
            ends = end if end is not None and end > begins else length_s
        return (begins, ends) if ends is not None and begins < ends else (start, end)


def verdicts(root: Path) -> dict[str, Verdict]:
    """By video, as a title mined again may give another prompt. Raises DamagedData."""
    files = manifest.rows(root, "labels/labels")
    if not files:
        return {}
    parquet.verify_files(*files)
    with database.over(files, root) as con:
        rows = con.execute(
            f"""SELECT video_id, annotator, question::VARCHAR, answer
            FROM {scan(files)} WHERE kind = 'task' QUALIFY labelled_at
                = max(labelled_at) OVER (PARTITION BY video_id, annotator)
            ORDER BY labelled_at, annotator, item_id, question::VARCHAR"""
        ).fetchall()
    answers: dict[str, dict[int, dict[str, str]]] = {}
    for video, annotator, question, answer in rows:
        answers.setdefault(video, {}).setdefault(annotator, {})[question] = answer
    return {video: _together(list(judges.values())) for video, judges in answers.items()}


def _together(judges: list[dict[str, str]]) -> Verdict:
    """`judges`: the answers of each one by question, the latest judge last."""
    counts = Counter((gate, one.get(gate)) for one in judges for gate in _GATES)
    rejected = any(counts[gate, "no"] > counts[gate, "yes"] for gate in _GATES)
    heard = [one for one in judges if all(one.get(gate) != "no" for gate in _GATES)]
    wordings = [one["wording"] for one in heard if one.get("wording")]
    begins, ends = (
        [float(one[question]) for one in heard if question in one]
        for question in ("begins_s", "ends_s")
    )
    return Verdict(
        len(judges),
        rejected,
        wordings[-1] if wordings else "",
        median(begins) if begins else None,
        median(ends) if ends else None,
    )
