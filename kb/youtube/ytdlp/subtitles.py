"""Subtitle files of YouTube's three timed forms → cues, as the plain form has them that a crawl
reads: one cue a line, in the track's order.

    srv3    <p t d> with <s t> for each word; `a="1"` only breaks the line of the rolling display;
            where YouTube answers with its plain form (<text start dur>), that is read
    json3   the same as events with `segs`; `aAppend` for `a`
    vtt     what the rolling display shows: a cue repeats the line before it, and cues of 10 ms hold
            only the repetition; <00:00:18.239><c> no</c> before each word

Automatic tracks have the time of every word. A vtt file does not tell how long a line stays once
the next one is there; automatic cues are cut there anyway (kb.youtube.parse.assemble).
"""

import html
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple
from xml.etree import ElementTree

import msgspec

_TAG = re.compile(r"<[^>]*>")  # as youtube-transcript-api takes them out
_WORD = re.compile(r"\S+")
_TIME = r"(?:(\d+):)?(\d\d):(\d\d)\.(\d\d\d)"
_TIMING = re.compile(rf"{_TIME}[ \t]+-->[ \t]+{_TIME}(?:[ \t].*)?")
_MARK = re.compile(r"<(?:(\d+):)?(\d\d):(\d\d)\.(\d\d\d)>")
_REPETITION_MS = 10


class Cue(NamedTuple):
    """A line. `word_start_s` has one start for each whitespace-separated word of `text`, None in
    a track without word times.
    """

    start_s: float
    duration_s: float
    text: str
    word_start_s: list[float] | None = None


class CaptionTrack(NamedTuple):
    """The cues of a file; `timed`: it has the time of every word."""

    cues: list[Cue]
    timed: bool


Parts = list[tuple[int, str]]
"""Pieces of a line, each with its start in ms."""


class _Line(NamedTuple):
    start: int
    end: int
    parts: Parts


def read(form: str, text: str) -> CaptionTrack:
    """The track in a file of the form vtt, srv3 or json3. Raises ValueError for anything else."""
    lines, timed = {"vtt": _vtt, "srv3": _srv3, "json3": _json3}[form](text.removeprefix("\ufeff"))
    cues = [_cue(line, timed) for line in lines]
    return CaptionTrack([cue for cue in cues if cue.text.strip()], timed)


def _cue(line: _Line, timed: bool) -> Cue:
    text = "".join(piece for _, piece in line.parts)
    starts = [start for start, piece in line.parts for _ in piece]
    for tag in reversed(list(_TAG.finditer(text))):
        text = text[: tag.start()] + text[tag.end() :]
        del starts[tag.start() : tag.end()]
    words = [starts[word.start()] / 1000 for word in _WORD.finditer(text)] if timed else None
    return Cue(line.start / 1000, max(0, line.end - line.start) / 1000, text, words)


# -- srv3 ------------------------------------------------------------------------------------------


def _srv3(text: str) -> tuple[list[_Line], bool]:
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from None
    if root.tag == "transcript":
        return [_plain_line(line) for line in root.iter("text")], False
    if root.tag != "timedtext":
        raise ValueError(f"<{root.tag}> in place of <timedtext>")
    lines, timed = [], False
    for line in root.iter("p"):
        if line.get("a") == "1":
            continue
        start, words = int(line.get("t", "0")), line.findall("s")
        parts = [(start, line.text or "")]
        for word in words:
            at = start + int(word.get("t", "0"))
            parts += [(at, "".join(word.itertext())), (at, word.tail or "")]
            timed = timed or "t" in word.attrib or "ac" in word.attrib
        if words:  # line breaks between the elements belong to the file, not to the text
            parts = [part for part in parts if part[1].strip() or "\n" not in part[1]]
        lines.append(_Line(start, start + int(line.get("d", "0")), parts))
    return lines, timed


def _plain_line(line: ElementTree.Element) -> _Line:
    start = round(float(line.get("start", "")) * 1000)
    length = round(float(line.get("dur", "0")) * 1000)
    return _Line(start, start + length, [(start, html.unescape(line.text or ""))])


# -- json3 -----------------------------------------------------------------------------------------


class _Segment(msgspec.Struct, gc=False):
    utf8: str | None = ""
    tOffsetMs: int = 0
    acAsrConf: Any = None


class _Event(msgspec.Struct, gc=False):
    tStartMs: int = 0
    dDurationMs: int = 0
    aAppend: int = 0
    segs: list[_Segment] = []


class _Events(msgspec.Struct, gc=False):
    events: list[_Event]


def _json3(text: str) -> tuple[list[_Line], bool]:
    try:
        events = msgspec.json.decode(text, type=_Events).events
    except msgspec.DecodeError as error:
        raise ValueError(f"not json3: {error}") from None
    lines, timed = [], False
    for event in events:
        if event.aAppend == 1 or not event.segs:
            continue
        start = event.tStartMs
        parts = [(start + segment.tOffsetMs, segment.utf8 or "") for segment in event.segs]
        marked = (one.tOffsetMs or one.acAsrConf is not None for one in event.segs)
        timed = timed or any(marked)
        lines.append(_Line(start, start + event.dDurationMs, parts))
    return lines, timed


# -- vtt -------------------------------------------------------------------------------------------


class _Row(NamedTuple):
    """A row of what is shown: its pieces, its text, and whether words in it have times."""

    parts: Parts
    text: str
    timed: bool


class _Shown(NamedTuple):
    """What is shown between two moments in ms: the rows that have a text."""

    start: int
    end: int
    rows: list[_Row]


def _vtt(text: str) -> tuple[list[_Line], bool]:
    if not text.startswith("WEBVTT"):
        raise ValueError("not WebVTT")
    cues = list(_cues(text))
    if not cues and "-->" in text:
        raise ValueError("no timing can be read")
    timed = any(row.timed for cue in cues for row in cue.rows)
    repeats = any(
        cue.rows
        and before.rows
        and cue.end - cue.start <= _REPETITION_MS
        and [row.text for row in cue.rows] == [before.rows[-1].text]
        for before, cue in pairwise(cues)
    )
    if timed or repeats:
        return _without_repetition(cues), timed
    return [_Line(cue.start, cue.end, _in_one(cue.rows)) for cue in cues], False


def _cues(text: str) -> Iterator[_Shown]:
    start = end = -1
    rows: list[_Row] = []
    for line in re.split(r"\r\n?|\n", text):
        if timing := _TIMING.fullmatch(line.rstrip()):
            if start >= 0:
                yield _Shown(start, end, rows)
            start, end = _ms(timing.groups()[:4]), _ms(timing.groups()[4:])
            rows = []
        elif start >= 0 and (row := _row(line, start)).text:
            rows.append(row)
    if start >= 0:
        yield _Shown(start, end, rows)


def _row(line: str, start: int) -> _Row:
    parts: Parts = []
    at, done = start, 0
    for mark in _MARK.finditer(line):
        parts.append((at, _plain(line[done : mark.start()])))
        at, done = _ms(mark.groups()), mark.end()
    parts.append((at, _plain(line[done:])))
    return _Row(parts, "".join(text for _, text in parts).strip(), len(parts) > 1)


def _plain(text: str) -> str:
    return html.unescape(_TAG.sub("", text))


def _ms(groups: tuple[str | None, ...]) -> int:
    hours, minutes, seconds, rest = (int(group or 0) for group in groups)
    return ((hours * 60 + minutes) * 60 + seconds) * 1000 + rest


def _without_repetition(cues: list[_Shown]) -> list[_Line]:
    """Each line once: from the cue that shows it first to the end of the last that still does."""
    lines: list[_Line] = []
    shown, until = [""], -1
    for start, end, rows in cues:
        if not rows:
            continue
        texts, new = [row.text for row in rows], rows
        if lines and start <= until and not rows[0].timed:
            same = texts == shown and not any(row.timed for row in rows)
            if same or texts[0] == shown[-1]:
                lines[-1] = lines[-1]._replace(end=end)
                new = [] if same else rows[1:]
        if new:
            lines.append(_Line(start, end, _in_one(new)))
        shown, until = texts, end
    return lines


def _in_one(rows: list[_Row]) -> Parts:
    parts = list(rows[0].parts) if rows else []
    for row in rows[1:]:
        (at, text), *others = row.parts
        parts += [(at, f"\n{text}"), *others]
    return parts


def as_lists(cues: list[Cue]) -> list[list[Any]]:
    """The cues as the raw answer of a crawl has them: [start_s, duration_s, text] each, and the
    starts of its words (s) in a track that has them.
    """
    return [list(cue if cue.word_start_s is not None else cue[:3]) for cue in cues]
