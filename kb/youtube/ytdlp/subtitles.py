"""Subtitle files and transcripts of speech recognition → cues, as a crawl reads them in YouTube's
plain form: one cue a line, in the track's order.

    srv3    <p t d> with <s t> for each word; `a="1"` only breaks the line of the rolling display;
            where YouTube answers with its plain form (<text start dur>), that is read
    json3   the same as events with `segs`; `aAppend` for `a`
    vtt     what the rolling display shows: a cue repeats the line before it, and cues of 10 ms hold
            only the repetition; <00:00:18.239><c> no</c> before each word. Identifiers of cues,
            notes, styles and regions are not speech (W3C WebVTT, section 4)
    srt     the same without times of words, where yt-dlp converted it. Whisper can underline the
            word that is spoken, in a cue of its own that repeats the whole text
    json    what programs of speech recognition heard (kb.youtube.ytdlp.speech_json)

A value that can't be read costs that value, or the line that can't be placed without it; what is
not of the form at all raises ValueError.

Automatic tracks have the time of every word. A vtt file does not tell how long a line stays once
the next one is there; automatic cues are cut there anyway (kb.youtube.parse.assemble).
"""

import html
import math
import re
from collections.abc import Iterator
from typing import Any, NamedTuple
from xml.etree import ElementTree

from kb.core.installation import np
from kb.crawl.file_text import json_value
from kb.youtube.ytdlp.speech_json import spoken_segments

_TAG = re.compile(r"</?(?:[A-Za-z][^<>]*)?>|<[\d:.]+>")
_WORD = re.compile(r"\S+")
_NO_LETTER = re.compile(r"[\W_]+")
_TIME = r"(?:(\d+):)?(\d\d):(\d\d)[.,](\d\d\d)"  # SubRip has a comma
_TIMING = re.compile(rf"{_TIME}[ \t]*-->[ \t]*{_TIME}(?:[ \t].*)?")
_MARK = re.compile(r"<(?:(\d+):)?(\d\d):(\d\d)\.(\d\d\d)>")
# What XML can't hold, as such or as a reference.
_NO_CHARACTER = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]|&#(?:[xX]([0-9a-fA-F]+)|([0-9]+));"
)
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
    """The cues of a file; `timed`: it has the time of every word; `dropped`: of so many words the
    times are not used, as the words are not those of the text.
    """

    cues: list[Cue]
    timed: bool
    dropped: int = 0


Parts = list[tuple[int, str]]
"""Pieces of a line, each with its start in ms."""


class _Line(NamedTuple):
    """`start` is -1 where it can't be read; `timed` is false for one without times of words, and
    `dropped` is how many of these do not fit its text.
    """

    start: int
    end: int
    parts: Parts
    timed: bool = True
    dropped: int = 0


def read(form: str, text: str) -> CaptionTrack:
    """The track in a file of the form vtt, srv3, json3, srt or json. Raises ValueError for anything
    else.
    """
    text = text.removeprefix("\ufeff")
    if form == "vtt" and not text.startswith("WEBVTT"):
        raise ValueError("not WebVTT")
    forms = {"vtt": _srt, "srv3": _srv3, "json3": _json3, "srt": _srt, "json": _recognised}
    lines, timed = forms[form](text)
    placed = [line for line in lines if line.start >= 0]
    if lines and not placed:
        raise ValueError("no line has a time that can be read")
    cues = []
    for line in placed:
        spoken = "".join(piece for _, piece in line.parts)
        starts = [start for start, piece in line.parts for _ in piece]
        words = [starts[word.start()] / 1000 for word in _WORD.finditer(spoken)]
        if words:
            length = max(0, line.end - line.start) / 1000
            cues.append(
                Cue(line.start / 1000, length, spoken, words if timed and line.timed else None)
            )
    return CaptionTrack(cues, timed, sum(line.dropped for line in placed))


def _milliseconds(value: Any, otherwise: int = 0) -> int:
    """A number of ms, however it is written."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return otherwise
    return round(number) if math.isfinite(number) and abs(number) < 1e12 else otherwise


# -- srv3 ------------------------------------------------------------------------------------------


def _srv3(text: str) -> tuple[list[_Line], bool]:
    try:
        root = ElementTree.fromstring(_NO_CHARACTER.sub(_replaced, text))
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from None
    lines, timed = [], False
    if root.tag == "transcript":
        for line in root.iter("text"):
            start = _seconds(line.get("start"))
            end = start + max(_seconds(line.get("dur", 0)), 0)
            # This form escapes its text twice: tags stand in it once.
            spoken = html.unescape(_TAG.sub("", line.text or ""))
            lines.append(_Line(start, end, [(start, spoken)]))
        return lines, False
    if root.tag != "timedtext":
        raise ValueError(f"<{root.tag}> in place of <timedtext>")
    for line in root.iter("p"):
        start = _milliseconds(line.get("t", 0), -1)
        if line.get("a") == "1":
            continue
        words = line.findall("s")
        parts = [(start, line.text or "")]
        for word in words:
            at = start + _milliseconds(word.get("t", 0))
            parts += [(at, "".join(word.itertext())), (at, word.tail or "")]
            timed = timed or "t" in word.attrib or "ac" in word.attrib
        if words:  # line breaks between the elements belong to the file, not to the text
            parts = [part for part in parts if part[1].strip() or "\n" not in part[1]]
        lines.append(_Line(start, start + _milliseconds(line.get("d", 0)), parts))
    return lines, timed


def _replaced(match: re.Match[str]) -> str:
    """U+FFFD for a character that XML can't hold; other references as they are."""
    hexadecimal, decimal = match.groups()
    if not (hexadecimal or decimal):
        return "\ufffd"
    code = int(hexadecimal, 16) if hexadecimal else int(decimal)
    valid = code in (9, 10, 13) or 0x20 <= code < 0xD800 or 0xE000 <= code < 0xFFFE
    return match[0] if valid or 0x10000 <= code <= 0x10FFFF else "\ufffd"


def _seconds(value: Any) -> int:
    """Seconds as ms, -1 for what is none."""
    try:
        number = float(value) * 1000
    except (TypeError, ValueError):
        return -1
    return round(number) if math.isfinite(number) else -1


# -- json3 -----------------------------------------------------------------------------------------


def _json3(text: str) -> tuple[list[_Line], bool]:
    document = json_value(text)
    events = document.get("events") if isinstance(document, dict) else None
    if not isinstance(events, list):
        raise ValueError("not json3: it has no events")  # noqa: TRY004 (a fact about the file)
    lines, timed = [], False
    for event in events:
        if not isinstance(event, dict) or not isinstance(event.get("segs"), list):
            continue
        start = _milliseconds(event.get("tStartMs", 0), -1)
        if _milliseconds(event.get("aAppend")) == 1:
            continue
        parts = []
        for segment in event["segs"]:
            if isinstance(segment, dict):
                offset, spoken = _milliseconds(segment.get("tOffsetMs")), segment.get("utf8")
                parts.append((start + offset, spoken if isinstance(spoken, str) else ""))
                timed = timed or bool(offset) or segment.get("acAsrConf") is not None
        lines.append(_Line(start, start + _milliseconds(event.get("dDurationMs")), parts))
    return lines, timed


# -- vtt -------------------------------------------------------------------------------------------


class _Row(NamedTuple):
    """A row of what is shown: its pieces, its text, and whether words in it have times or are
    underlined.
    """

    parts: Parts
    text: str
    timed: bool
    underlined: bool


_Shown = tuple[int, int, list[_Row]]
"""What is shown between two moments in ms: the rows that have a text."""


def _srt(text: str) -> tuple[list[_Line], bool]:
    cues = list(_cues(text))
    if not cues and "-->" in text:
        raise ValueError("no timing can be read")
    timed = any(row.timed for _, _, rows in cues for row in rows)
    return _without_repetition(cues, timed), timed


def _cues(text: str) -> Iterator[_Shown]:
    """Only what stands between a timing and a line that is truly empty is shown: YouTube's cues
    hold lines of one space.
    """
    start = end = 0
    rows: list[_Row] | None = None
    for line in re.split(r"\r\n?|\n", text):
        timing = _TIMING.fullmatch(line.strip(" \t"))
        if timing or not line or line.lstrip().startswith("-->"):
            if rows is not None:
                yield start, end, rows
            rows = None
            if timing:
                groups = timing.groups()
                start, end, rows = _ms(groups[:4]), _ms(groups[4:]), []
        elif rows is not None and (row := _row(line, start)).text:
            rows.append(row)
    if rows is not None:
        yield start, end, rows


def _row(line: str, start: int) -> _Row:
    pieces, at, done = [], start, 0
    for mark in _MARK.finditer(line):
        pieces.append((at, line[done : mark.start()]))
        at, done = _ms(mark.groups()), mark.end()
    pieces.append((at, line[done:]))
    parts = [(at, html.unescape(_TAG.sub("", piece))) for at, piece in pieces]
    spoken = "".join(text for _, text in parts).strip()
    return _Row(parts, spoken, len(parts) > 1, "<u>" in line)


def _ms(groups: tuple[str | None, ...]) -> int:
    hours, minutes, seconds, rest = (int(group or 0) for group in groups)
    return ((hours * 60 + minutes) * 60 + seconds) * 1000 + rest


def _without_repetition(cues: list[_Shown], timed: bool) -> list[_Line]:
    """Each line once: from the cue that shows it first to the end of the last that still does.

    In a track with word times what is said has them, so that a first row without is a repetition,
    however long nothing was shown before. Without word times people may say a line twice: there
    only what a cue of 10 ms repeats counts as shown on, the first row of the cue right behind such
    a one, and what is shown again with another word underlined.
    """
    lines: list[_Line] = []
    shown, until, after_brief, underlined = [""], -1, False, False
    for start, end, rows in cues:
        if not rows:
            continue
        texts, new = [row.text for row in rows], rows
        brief = end - start <= _REPETITION_MS
        underlined = any(row.underlined for row in rows) or (underlined and texts == shown)
        is_rolling = timed or brief or underlined or (after_brief and len(rows) > 1)
        after_brief = False
        follows = start <= until
        if lines and (follows or timed) and not rows[0].timed and is_rolling:
            same = texts == shown and not any(row.timed for row in rows)
            if same or texts[0] == shown[-1]:
                if follows:
                    lines[-1] = lines[-1]._replace(end=end)
                new = [] if same else rows[1:]
                after_brief = brief
        if new:
            lines.append(_Line(start, end, _in_one(new)))
        shown, until = texts, end
    return lines


def _in_one(rows: list[_Row]) -> Parts:
    parts = list(rows[0].parts)
    for row in rows[1:]:
        (at, text), *others = row.parts
        parts += [(at, f"\n{text}"), *others]
    return parts


# -- json ------------------------------------------------------------------------------------------


def _recognised(text: str) -> tuple[list[_Line], bool]:
    lines = []
    for segment in spoken_segments(text):
        start, end, spoken = segment.start, segment.end, segment.text.strip()
        starts = _every_start([word.start for word in segment.words], start, end)
        pieces = _pieces(spoken, [word.text for word in segment.words])
        if not (pieces and starts):
            dropped = sum(word.start >= 0 for word in segment.words)
            lines.append(_Line(start, end, [(start, spoken)], timed=False, dropped=dropped))
            continue
        parts = [*zip(starts, pieces, strict=True)]
        parts[0] = (parts[0][0], parts[0][1].lstrip())
        parts[-1] = (parts[-1][0], parts[-1][1].rstrip())
        lines.append(_Line(starts[0] if start < 0 else start, max(end, starts[-1]), parts))
    return lines, any(line.timed for line in lines)


def _pieces(spoken: str, heard: list[str]) -> list[str]:
    """What was heard, as pieces that make up the text, which may be ""; [] where they don't."""
    # Whisper's words bring their spaces along, WhisperX's don't.
    for glue in ("", " "):
        joined = glue.join(heard).split()
        if joined == (spoken or " ".join(heard)).split():
            return [f"{piece}{glue}" for piece in heard]
    words = spoken.split()  # some programs write signs and capitals in the text alone
    alike = [_NO_LETTER.sub("", word).casefold() for word in words]
    fits = alike == [_NO_LETTER.sub("", word).casefold() for word in heard]
    return [f"{word} " for word in words] if fits else []


def _every_start(starts: list[int], begin: int, end: int) -> list[int]:
    """The starts (ms) of a segment's words, of those without one (-1, such as WhisperX's numbers)
    in equal parts of what lies between; [] where no word has one.
    """
    known = {place: start for place, start in enumerate(starts) if start >= 0}
    if not known:
        return []
    ends = {0: begin if begin >= 0 else min(known.values()), len(starts): end}
    places, times = zip(
        *sorted(({at: t for at, t in ends.items() if t >= 0} | known).items()), strict=True
    )
    return [round(at) for at in np.interp(range(len(starts)), places, times)]


def as_columns(cues: list[Cue]) -> dict[str, list[Any] | None]:
    """The cues as the raw answer of a crawl has them: a list for each field; `word_start_s` is None
    where no cue has times of words.
    """
    columns: dict[str, list[Any] | None] = {
        name: [cue[place] for cue in cues] for place, name in enumerate(Cue._fields)
    }
    if all(cue.word_start_s is None for cue in cues):
        columns["word_start_s"] = None
    return columns
