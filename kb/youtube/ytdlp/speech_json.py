"""JSON of speech recognition → segments with times, and the language that was heard.

    Whisper, WhisperX, faster-whisper   `segments`, or a list of them, with `start` and `end` (s);
                                        OpenAI's `words` beside them or alone
    whisper.cpp                         `transcription` with `offsets` (ms), perhaps `tokens`
    Transformers                        `chunks` with a `timestamp` (s)
    AWS Transcribe                      `results` with `audio_segments`, or `items` alone
    Google Speech-to-Text               a list of `results`, each with `alternatives`
    Deepgram                            `results` with `utterances`, or `channels` with words
    AssemblyAI                          `utterances`, `sentences` or `words` (ms)
    Vosk                                `result` with words, a document an utterance; `monologues`

Words without segments are cut into some where a sentence ends, or nothing is said for a second.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any, NamedTuple

from kb.core.languages import code_of
from kb.crawl.file_text import documents, json_value

_PAUSE = 1_000  # ms
_MOST_WORDS = 30  # of a segment that is made of words
_SENTENCE_ENDS = (".", "?", "!", "。", "？", "！")


class SpokenWord(NamedTuple):
    """A word, or a part of one, as it was heard; times in ms, -1 where they can't be read."""

    start: int
    end: int
    text: str


class SpokenSegment(NamedTuple):
    """Some words that belong together; times as those of words. `text` is "" where only its words
    have one.
    """

    start: int
    end: int
    text: str
    words: list[SpokenWord]


def spoken_segments(text: str) -> list[SpokenSegment]:
    """The segments in a file. Raises ValueError where it has none with times."""
    document = _document(text)
    for segments_of in _FORMS.values():
        segments = segments_of(document)
        if segments is not None:
            return segments
    known = ", ".join(_FORMS)
    raise ValueError(f"it has no segments with times in a form of {known}")


def heard_language(text: str) -> str | None:
    """The language that a file names; None where it names none."""
    document = _document(text)
    names = chain(
        *(
            (_at(document, *path, "language"), _at(document, *path, "language_code"))
            for path in ((), ("info",), ("result",), ("results",))
        ),
        (_at(result, "languageCode") for result in _list(document, "results")),
        (_at(part, "detected_language") for part in _list(document, "results", "channels")),
    )
    return next((code_of(name) for name in names if isinstance(name, str) and name), None)


def _document(text: str) -> Any:
    """The value in a file, or all of them where several stand one after the other."""
    try:
        return json_value(text)
    except ValueError as error:
        try:
            return [*documents(text)]
        except (ValueError, RecursionError):
            raise error from None


# -- the forms; each answers None for a document of another one ------------------------------------


def _whisper(document: Any) -> list[SpokenSegment] | None:
    given = document.get("segments") if isinstance(document, dict) else document
    if isinstance(given, list):
        given = [_faster_whisper(segment) for segment in given]
    heard = [_word(word, _seconds, "word") for word in _list(document, "words") if "word" in word]
    if not isinstance(given, list) or (given and not _objects(given)):
        return _cut(heard) if heard else None
    segments = [_segment(one, _seconds, "text", "word") for one in _objects(given)]
    if (
        segments and heard and not any(segment.words for segment in segments)
    ):  # OpenAI's stand beside them
        starts = [segment.start for segment in segments]
        for word in heard:
            segments[max(bisect_right(starts, word.start) - 1, 0)].words.append(word)
    return segments


def _faster_whisper(segment: Any) -> Any:
    """A segment that json.dump made a list of, as it does with the named tuples of versions before
    1.1: `id, seek, start, end, text, …`, among them words as `start, end, word, probability`.
    """
    match segment:
        case [_, _, start, end, str(text), *others]:
            words = [
                {"start": word[0], "end": word[1], "word": word[2]}
                for values in others
                if isinstance(values, list)
                for word in values
                if isinstance(word, list) and len(word) == 4
            ]
            return {"start": start, "end": end, "text": text, "words": words}
    return segment


def _whisper_cpp(document: Any) -> list[SpokenSegment] | None:
    if not isinstance(_at(document, "transcription"), list):
        return None
    return [
        SpokenSegment(
            *_offsets(segment),
            str(segment.get("text", "")),
            [
                SpokenWord(*_offsets(token), str(token.get("text", "")))
                for token in _list(segment, "tokens")
                if not str(token.get("text", "")).startswith("[_")  # marks of the model
            ],
        )
        for segment in _list(document, "transcription")
    ]


def _transformers(document: Any) -> list[SpokenSegment] | None:
    if not isinstance(_at(document, "chunks"), list):
        return None
    chunks = [
        SpokenWord(*_pair(chunk.get("timestamp")), str(chunk.get("text", "")).strip())
        for chunk in _list(document, "chunks")
    ]
    if all(len(chunk.text.split()) <= 1 for chunk in chunks):  # asked for the times of words
        return _cut(chunks)
    return [SpokenSegment(*chunk, []) for chunk in chunks]


def _aws(document: Any) -> list[SpokenSegment] | None:
    items = _at(document, "results", "items")
    if not isinstance(items, list):
        return None
    words: list[SpokenWord] = []
    number_of: dict[Any, int] = {}  # id of an item → its word
    for place, item in enumerate(_objects(items)):
        content = str(_at(_first(item.get("alternatives")), "content") or "")
        if item.get("type") == "punctuation" and words:
            words[-1] = words[-1]._replace(text=words[-1].text + content)
        else:
            begin, end = (_seconds(item.get(name)) for name in ("start_time", "end_time"))
            words.append(SpokenWord(begin, end, content))
        number_of[item.get("id", place)] = len(words) - 1
    segments = [
        _joined(
            [words[at] for at in dict.fromkeys(map(number_of.get, named)) if at is not None],
            _seconds(segment.get("start_time")),
            _seconds(segment.get("end_time")),
        )
        for segment in _list(document, "results", "audio_segments")
        if isinstance(named := segment.get("items"), list)
    ]
    return segments or _cut(words)


def _google(document: Any) -> list[SpokenSegment] | None:
    results = _at(document, "results")
    if results is None:  # of an operation that took a while
        results = _at(document, "response", "results")
    if not isinstance(results, list) or not any("alternatives" in one for one in _objects(results)):
        return None
    segments: list[SpokenSegment] = []
    end = 0
    for result in _objects(results):
        best = _first(result.get("alternatives"))
        words = [
            SpokenWord(*_span(word, "startTime", "endTime"), str(word.get("word", "")))
            if "startTime" in word or "endTime" in word
            else SpokenWord(*_span(word, "startOffset", "endOffset"), str(word.get("word", "")))
            for word in _list(best, "words")
        ]
        begin = words[0].start if words else end
        known = result.get("resultEndTime", result.get("resultEndOffset"))
        end = words[-1].end if words else _seconds(known)
        if text := str(_at(best, "transcript") or "").strip():  # else all words again, by speaker
            segments.append(SpokenSegment(begin if end >= 0 else -1, end, text, words))
    return segments


def _deepgram(document: Any) -> list[SpokenSegment] | None:
    channels = _at(document, "results", "channels")
    if not isinstance(channels, list):
        return None
    if utterances := _list(document, "results", "utterances"):
        return [_segment(one, _seconds, "transcript", "word") for one in utterances]
    heard = [
        word
        for channel in _objects(channels)
        for word in _list(_first(channel.get("alternatives")), "words")
    ]
    return _cut(_word(one, _seconds, "punctuated_word", "word") for one in heard)


def _assembly_ai(document: Any) -> list[SpokenSegment] | None:
    for name in ("utterances", "sentences"):
        if given := _list(document, name):
            return [_segment(one, _milliseconds, "text", "text") for one in given]
    words = _list(document, "words")
    if not any("text" in word for word in words):
        return None
    return _cut(_word(one, _milliseconds, "text") for one in words)


def _vosk(document: Any) -> list[SpokenSegment] | None:
    if monologues := _list(document, "monologues"):
        return [
            _segment(one | {"words": one.get("terms")}, _seconds, "text", "text")
            for one in monologues
        ]
    utterances = _objects(document) if isinstance(document, list) else _objects([document])
    if not any(isinstance(one.get("result"), list) for one in utterances):
        return None
    heard = ([_word(word, _seconds, "word") for word in _list(one, "result")] for one in utterances)
    return [_joined(words) for words in heard if words]


_FORMS: dict[str, Callable[[Any], list[SpokenSegment] | None]] = {
    "whisper.cpp": _whisper_cpp,
    "Transformers": _transformers,
    "AWS Transcribe": _aws,
    "Deepgram": _deepgram,
    "Google Speech-to-Text": _google,
    "AssemblyAI": _assembly_ai,
    "Vosk": _vosk,
    "Whisper": _whisper,
}


# -- their parts -----------------------------------------------------------------------------------


def _segment(
    given: dict[str, Any], time: Callable[[Any], int], text: str, *word: str
) -> SpokenSegment:
    """A segment with `start`, `end` and perhaps `words`; `text`, `word`: names of its texts."""
    spoken = given.get(text)
    words = [_word(one, time, *word) for one in _list(given, "words")]
    begin, end = time(given.get("start")), time(given.get("end"))
    return SpokenSegment(begin, end, spoken if isinstance(spoken, str) else "", words)


def _word(given: dict[str, Any], time: Callable[[Any], int], *names: str) -> SpokenWord:
    text = next((given[name] for name in names if name in given), "")
    return SpokenWord(time(given.get("start")), time(given.get("end")), str(text))


def _joined(words: list[SpokenWord], begin: int = -1, end: int = -1) -> SpokenSegment:
    """Words as a segment; its times are theirs where it has none."""
    begin = begin if begin >= 0 else next((word.start for word in words if word.start >= 0), -1)
    end = max([end, *(max(word.start, word.end) for word in words)])
    return SpokenSegment(begin, end, " ".join(word.text for word in words), words)


def _cut(words: Iterable[SpokenWord]) -> list[SpokenSegment]:
    """Words in order as segments."""
    parts: list[list[SpokenWord]] = []
    for word in words:
        last = parts[-1][-1] if parts else None
        if (
            last is None
            or len(parts[-1]) == _MOST_WORDS
            or last.text.endswith(_SENTENCE_ENDS)
            or (word.start >= 0 and word.start - max(last.start, last.end) >= _PAUSE)
        ):
            parts.append([])
        parts[-1].append(word)
    return [_joined(part) for part in parts]


def _at(value: Any, *path: str) -> Any:
    """What stands at a path of names; None where nothing does."""
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _list(value: Any, *path: str) -> list[dict[str, Any]]:
    """The objects in the list at a path."""
    given = _at(value, *path)
    return [*_objects(given)] if isinstance(given, list) else []


def _objects(values: Iterable[Any]) -> list[dict[str, Any]]:
    return [value for value in values if isinstance(value, dict)]


def _first(values: Any) -> Any:
    objects = _objects(values) if isinstance(values, list) else []
    return objects[0] if objects else None


def _span(given: dict[str, Any], begin: str, end: str) -> tuple[int, int]:
    """Two times; Google leaves out those that are 0."""
    return _seconds(given.get(begin, 0)), _seconds(given.get(end, 0))


def _pair(given: Any) -> tuple[int, int]:
    begin, end = given if isinstance(given, list) and len(given) == 2 else (None, None)
    return _seconds(begin), _seconds(end)


def _offsets(given: dict[str, Any]) -> tuple[int, int]:
    begin, end = (_milliseconds(_at(given, "offsets", name)) for name in ("from", "to"))
    return begin, end


def _milliseconds(value: Any) -> int:
    """A time in ms, -1 for what is none."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return -1
    return round(number) if math.isfinite(number) and abs(number) < 1e12 else -1


def _seconds(value: Any) -> int:
    """The same of seconds: 1.5, "1.5", "1.5s" or the object of Google's protocol."""
    if isinstance(value, dict):
        whole, rest = value.get("seconds", 0), value.get("nanos", 0)
        return _milliseconds(whole) * 1000 + round(_milliseconds(rest) / 1e6)
    number = value.removesuffix("s") if isinstance(value, str) else value
    try:
        return _milliseconds(float(number) * 1000)
    except (TypeError, ValueError):
        return -1
