"""What every program of speech recognition writes gives the same cues, or is named."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from kb.youtube.ytdlp import subtitles
from kb.youtube.ytdlp.speech_json import heard_language
from tests.youtube.job import Job
from tests.youtube.ytdlp.folder import video_id, write_video

# (start in ms, text); a word every 300 ms, a segment lasts 2.4 s, and then nothing is said.
SAID = [(500, "Well, we build a farm."), (4_500, "It needs 3 villagers.")]
LENGTH = 2_400


def words(start: int, text: str) -> list[tuple[int, int, str]]:
    """Start, end (ms) and text of each word."""
    return [
        (start + 300 * place, start + 300 * place + 250, word)
        for place, word in enumerate(text.split())
    ]


EVERY = [word for said in SAID for word in words(*said)]


def stamp(ms: int) -> str:
    return f"00:00:{ms // 1000:02},{ms % 1000:03}"


def whisper_cpp() -> Any:
    def part(start: int, end: int, text: str) -> dict[str, Any]:
        times = {"from": stamp(start), "to": stamp(end)}
        return {"timestamps": times, "offsets": {"from": start, "to": end}, "text": text}

    segments = []
    for start, text in SAID:
        tokens = [part(start, start, "[_BEG_]")]
        for begin, end, word in words(start, text):  # a long word is of two tokens
            half = len(word) // 2 if len(word) > 5 else len(word)
            tokens.append(part(begin, end, f" {word[:half]}"))
            tokens += [part(begin + 100, end, word[half:])] if word[half:] else []
        segments.append(part(start, start + LENGTH, f" {text}") | {"tokens": tokens})
    return {"params": {}, "result": {"language": "en"}, "transcription": segments}


def openai() -> Any:
    """Words stand beside the segments, without signs."""
    return {
        "language": "english",
        "duration": 8.0,
        "segments": [
            {"id": 0, "start": start / 1000, "end": (start + LENGTH) / 1000, "text": f" {text}"}
            for start, text in SAID
        ],
        "words": [
            {"word": word.strip(",."), "start": start / 1000, "end": end / 1000}
            for start, end, word in EVERY
        ],
    }


def faster_whisper_lists() -> Any:
    """Named tuples of its versions before 1.1, as json.dump writes them."""
    return [
        [
            *(number, 0, start / 1000, (start + LENGTH) / 1000, f" {text}", [50_364, 1042]),
            *(0.0, -0.2, 1.4, 0.01),
            [
                [begin / 1000, end / 1000, f" {word}", 0.9]
                for begin, end, word in words(start, text)
            ],
        ]
        for number, (start, text) in enumerate(SAID)
    ]


def transformers() -> Any:
    chunks = [
        {"timestamp": [start / 1000, end / 1000], "text": f" {word}"} for start, end, word in EVERY
    ]
    return {"speakers": [], "chunks": chunks, "text": " ".join(text for _, text in SAID)}


def aws(segments: bool = True) -> Any:
    items: list[dict[str, Any]] = []
    lists: list[list[int]] = []
    for said in SAID:
        lists.append([])
        for start, end, word in words(*said):
            plain, sign = word.rstrip(",."), word[len(word.rstrip(",.")) :]
            times = {"start_time": f"{start / 1000}", "end_time": f"{end / 1000}"}
            for kind, content in (("pronunciation", plain), ("punctuation", sign)):
                if content:
                    lists[-1].append(len(items))
                    about = {"id": len(items), "type": kind}
                    alternatives = [{"confidence": "0.9", "content": content}]
                    items.append(
                        about | (times if content == plain else {}) | {"alternatives": alternatives}
                    )
    audio = [
        {
            "id": number,
            "transcript": text,
            "start_time": f"{start / 1000}",
            "end_time": f"{(start + LENGTH) / 1000}",
            "items": lists[number],
        }
        for number, (start, text) in enumerate(SAID)
    ]
    results = {"language_code": "en-US", "items": items, "transcripts": [{"transcript": "…"}]}
    return {"results": results | ({"audio_segments": audio} if segments else {})}


def google(time: Callable[[int], Any] = lambda ms: f"{ms / 1000}s") -> Any:
    results = [
        {
            "alternatives": [
                {
                    "transcript": f" {text}",
                    "words": [
                        {"startTime": time(begin), "endTime": time(end), "word": word}
                        for begin, end, word in words(start, text)
                    ],
                }
            ],
            "resultEndTime": time(start + LENGTH),
            "languageCode": "en-us",
        }
        for start, text in SAID
    ]
    by_speaker = [{"startTime": time(s), "endTime": time(e), "word": w} for s, e, w in EVERY]
    return {"results": [*results, {"alternatives": [{"words": by_speaker}]}]}


def deepgram(utterances: bool = True) -> Any:
    def heard(word: tuple[int, int, str]) -> dict[str, Any]:
        start, end, text = word
        plain = text.strip(",.").lower()
        times = {"start": start / 1000, "end": end / 1000}
        return {"word": plain, "punctuated_word": text, "confidence": 0.9, **times}

    channel = {
        "alternatives": [{"transcript": "…", "words": [heard(word) for word in EVERY]}],
        "detected_language": "en",
    }
    spoken = [
        {
            "start": start / 1000,
            "end": (start + LENGTH) / 1000,
            "transcript": text,
            "words": [heard(word) for word in words(start, text)],
        }
        for start, text in SAID
    ]
    results = {"channels": [channel]} | ({"utterances": spoken} if utterances else {})
    return {"metadata": {"duration": 8.0}, "results": results}


def assembly_ai(segments: str = "utterances") -> Any:
    def heard(word: tuple[int, int, str]) -> dict[str, Any]:
        return {"start": word[0], "end": word[1], "text": word[2], "speaker": "A"}

    spoken = [
        {
            "start": start,
            "end": start + LENGTH,
            "text": text,
            "words": [heard(word) for word in words(start, text)],
        }
        for start, text in SAID
    ]
    every = [heard(word) for word in EVERY]
    about = {"language_code": "en_us", "text": "…", "words": every, "utterances": None}
    return about | ({segments: spoken} if segments else {})


def vosk() -> list[Any]:
    def heard(start: int, text: str) -> list[dict[str, Any]]:
        return [
            {"conf": 1.0, "start": begin / 1000, "end": end / 1000, "word": word}
            for begin, end, word in words(start, text)
        ]

    return [*({"result": heard(*said), "text": said[1]} for said in SAID), {"text": ""}]


def vosk_transcriber() -> Any:
    monologues = []
    for start, text in SAID:
        terms = [
            {"confidence": 1, "start": begin / 1000, "end": end / 1000, "text": word}
            for begin, end, word in words(start, text)
        ]
        times = {"start": start / 1000, "end": (start + LENGTH) / 1000}
        monologues.append({"speaker": {"id": "unknown"}, "text": text, "terms": terms, **times})
    return {"schemaVersion": "2.0", "monologues": monologues, "text": []}


def seconds_and_nanos(ms: int) -> dict[str, Any]:
    return {"seconds": str(ms // 1000), "nanos": ms % 1000 * 1_000_000}


FORMS: dict[str, Callable[[], Any]] = {
    "whisper.cpp": whisper_cpp,
    "OpenAI": openai,
    "OpenAI's words alone": lambda: {"words": openai()["words"]},
    "faster-whisper's lists": faster_whisper_lists,
    "Transformers": transformers,
    "AWS": aws,
    "AWS without segments": lambda: aws(segments=False),
    "Google": google,
    "Google's objects": lambda: google(seconds_and_nanos),
    "Google's operation": lambda: {"done": True, "response": google()},
    "Deepgram": deepgram,
    "Deepgram without utterances": lambda: deepgram(utterances=False),
    "AssemblyAI": assembly_ai,
    "AssemblyAI's sentences": lambda: assembly_ai("sentences"),
    "AssemblyAI's words alone": lambda: assembly_ai(""),
    "Vosk": vosk,
    "Vosk's transcriber": vosk_transcriber,
}


@pytest.mark.parametrize("name", FORMS)
def test_segments_and_the_times_of_words_are_read(name: str) -> None:
    track = subtitles.read("json", json.dumps(FORMS[name]()))
    texts = [text for _, text in SAID]
    if name == "OpenAI's words alone":
        texts = [text.replace(",", "").replace(".", "") for text in texts]
    assert [cue.text for cue in track.cues] == texts
    assert [cue.start_s for cue in track.cues] == [start / 1000 for start, _ in SAID]
    assert [cue.word_start_s for cue in track.cues] == [
        [start / 1000 for start, _, _ in words(*said)] for said in SAID
    ]
    assert all(0.9 < cue.duration_s <= LENGTH / 1000 for cue in track.cues)
    assert track.dropped == 0


def test_results_that_stand_one_after_the_other_are_one_transcript() -> None:
    """As Vosk's examples print them."""
    lines = "\n".join(json.dumps(result, indent=2) for result in vosk())
    assert subtitles.read("json", lines) == subtitles.read("json", json.dumps(vosk()))


def test_segments_alone_are_enough() -> None:
    whole = google()
    for result in whole["results"]:
        for heard in result["alternatives"]:
            del heard["words"]
    track = subtitles.read("json", json.dumps(whole))
    assert [(cue.start_s, cue.text) for cue in track.cues] == [(0, SAID[0][1]), (2.9, SAID[1][1])]
    assert not track.timed


@pytest.mark.parametrize(
    ("name", "language"),
    [
        ("whisper.cpp", "en"), ("OpenAI", "en"), ("AWS", "en-US"), ("Google", "en-US"),
        ("Deepgram", "en"), ("AssemblyAI", "en-US"), ("Vosk", None), ("Transformers", None),
    ],
)  # fmt: skip
def test_the_language_that_was_heard(name: str, language: str | None) -> None:
    assert heard_language(json.dumps(FORMS[name]())) == language


@pytest.mark.parametrize(
    "document",
    [
        {"text": "so we build"},
        {"results": {"transcripts": [{"transcript": "so we build"}]}},
        {"text": "so we build", "segments": None, "words": None},
        ["so", "we"],
        {"chunks": "many"},
        7,
    ],
)
def test_what_has_no_times_names_the_forms_that_are_read(document: Any) -> None:
    with pytest.raises(ValueError, match=r"no segments with times in a form of .*Deepgram"):
        subtitles.read("json", json.dumps(document))


@pytest.mark.parametrize("name", FORMS)
def test_a_value_that_can_not_be_read_costs_that_value(name: str) -> None:
    def odd(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: odd(part) for key, part in value.items()}
        if isinstance(value, list) and any(isinstance(part, dict) for part in value):
            return [None, "?", *map(odd, value)]
        return value

    whole = FORMS[name]()
    track = subtitles.read("json", json.dumps(odd(whole)))
    assert track == subtitles.read("json", json.dumps(whole))


def test_times_of_words_that_are_not_those_of_the_text_are_counted_and_said(job: Job) -> None:
    whole = deepgram()
    for heard in whole["results"]["utterances"][1]["words"]:
        heard["word"] = "so"
    track = subtitles.read("json", json.dumps(whole))
    assert (track.dropped, track.timed) == (4, True)
    assert [cue.word_start_s is None for cue in track.cues] == [False, True]
    folder, own = job.place / "videos", job.place / "own"
    own.mkdir()
    write_video(folder, 1, ())
    (own / f"{video_id(1)}.json").write_text(json.dumps(whole))
    words = ("youtube", "import", str(folder), "--own-transcripts", str(own))
    done = job.kb(*words)
    assert "4 times of words are not used" in done.stdout
    assert f"{video_id(1)}.json (4)" in done.stdout
