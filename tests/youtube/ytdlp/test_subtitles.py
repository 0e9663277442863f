"""One track in yt-dlp's three forms gives what the crawl's client reads in the plain form."""

import json
from html import escape
from xml.sax.saxutils import escape as xml

import pytest
from youtube_transcript_api._transcripts import _TranscriptParser

from kb.youtube.ytdlp import subtitles
from tests.youtube.ytdlp.folder import FORMS, Line, spoken, vtt


def plain(lines: list[Line]) -> str:
    """What the crawl's client reads: `fmt` left out."""
    body = "".join(
        f'<text start="{line.start / 1000:g}" dur="{line.length / 1000:g}">'
        f"{xml(escape(line.text))}</text>"
        for line in lines
    )
    return f'<?xml version="1.0" encoding="utf-8" ?><transcript>{body}</transcript>'


AUTOMATIC = {
    "flowing": spoken("we're no strangers to", "love you know the rules", "and so do I", "a full"),
    "pause": spoken("first line here", "second line", "third after the pause", "x", pause_after=1),
    "pause at once": spoken("alone", "then some words", "more", pause_after=0),
    "marks": spoken("[Music]", ">> hello & welcome", "a < b", "[Applause]", "and it's done"),
    "single words": spoken("yeah", "no", "yeah", "yeah", "well then"),
    "one line": spoken("only this"),
}
MANUAL = [
    Line(0, 1_500, [(0, "Hello there")]),
    Line(1_500, 2_000, [(0, "two rows\nof text")]),
    Line(4_000, 10, [(0, "two rows\nof text & more")]),
    Line(4_010, 990, [(0, "it's <fine>")]),
    Line(3_600_000, 1_234, [(0, "an hour later")]),
]


def crawled(lines: list[Line]) -> list[tuple[float, float, str]]:
    """The cues that the crawl's client makes of the plain form."""
    return [(cue.start, cue.duration, cue.text) for cue in _TranscriptParser().parse(plain(lines))]


def shown(cues: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """With the lengths that automatic cues have in the clean table: until the next one starts."""
    ends = [*(cue[0] for cue in cues[1:]), float("inf")]
    return [
        (start, round(min(length, end - start), 3), text)
        for (start, length, text), end in zip(cues, ends, strict=True)
    ]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", AUTOMATIC)
def test_automatic_tracks_have_the_cues_of_the_plain_form(form: str, name: str) -> None:
    lines = AUTOMATIC[name]
    track = subtitles.read(form, FORMS[form](lines, automatic=True))
    cues = [cue[:3] for cue in track.cues]
    assert shown(cues) == shown(crawled(lines))
    if form != "vtt":  # which does not tell how long a line stays beside the next one
        assert cues == crawled(lines)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", AUTOMATIC)
def test_automatic_tracks_keep_the_start_of_every_word(form: str, name: str) -> None:
    lines = AUTOMATIC[name]
    track = subtitles.read(form, FORMS[form](lines, automatic=True))
    expected = [[(line.start + offset) / 1000 for offset, _ in line.words] for line in lines]
    if track.timed:
        assert [cue.word_start_s for cue in track.cues] == expected
    for cue in track.cues:
        assert cue.word_start_s is None or len(cue.word_start_s) == len(cue.text.split())
    many = any(len(line.words) > 1 for line in lines)
    assert track.timed or (form == "vtt" and not many)


@pytest.mark.parametrize("form", FORMS)
def test_manual_tracks_are_as_they_are(form: str) -> None:
    track = subtitles.read(form, FORMS[form](MANUAL, automatic=False))
    own = [(one.start / 1000, one.length / 1000, one.text) for one in MANUAL]
    assert [cue[:3] for cue in track.cues] == own
    assert not track.timed
    assert {cue.word_start_s for cue in track.cues} == {None}


def test_a_translated_track_rolls_without_times_of_words() -> None:
    lines = AUTOMATIC["flowing"]
    track = subtitles.read("vtt", vtt(lines, automatic=True, words=False))
    assert shown([cue[:3] for cue in track.cues]) == shown(crawled(lines))
    assert not track.timed


def test_windows_ends_of_lines_and_a_mark_at_the_beginning_change_nothing() -> None:
    text = vtt(AUTOMATIC["flowing"], automatic=True)
    assert subtitles.read("vtt", "\ufeff" + text.replace("\n", "\r\n")) == subtitles.read(
        "vtt", text
    )


def test_colours_of_older_files_are_no_words() -> None:
    text = (
        "WEBVTT\nKind: captions\nLanguage: en\nStyle:\n"
        "::cue(c.colorCCCCCC) { color: rgb(204,204,204);\n }\n##\n\n"
        "00:00:00.030 --> 00:00:01.610 align:start position:0%\n \n"
        "all<00:00:00.240><c> right</c><c.colorCCCCCC><00:00:00.719><c> here</c></c>\n\n"
        "00:00:01.610 --> 00:00:01.620 align:start position:0%\n"
        "all right<c.colorCCCCCC> here\n </c>\n"
    )
    track = subtitles.read("vtt", text)
    assert [(cue.text, cue.word_start_s) for cue in track.cues] == [
        ("all right here", [0.03, 0.24, 0.719])
    ]


BLOCKS = """WEBVTT - a kiln
Kind: captions

STYLE
::cue { color: red }

REGION
id:below
width:40%

NOTE bisque, or is it
glaze?

1
00:01.000-->00:02.000
NOTE what she says
STYLE matters: 1 --> 2

intro to glazing
00:00:03.000 --> 00:00:04.000 align:start
<v Ann>Load <i>the</i> kiln

which is no speech any more
00:00:05.000 --> 00:00:06.000
\N{SPACE}
47

47
 -->
"""


def test_only_what_stands_in_a_cue_is_speech() -> None:
    for text in (BLOCKS, BLOCKS.replace("\n", "\r\n"), BLOCKS.replace("\n", "\r")):
        assert [cue.text for cue in subtitles.read("vtt", text).cues] == [
            "NOTE what she says\nSTYLE matters: 1 --> 2",
            "Load the kiln",
            "47",
        ]


@pytest.mark.parametrize("gap_s", [0, 1, 30])
@pytest.mark.parametrize("brief", ["01.010", "01.900"])
def test_a_repetition_without_word_times_is_none_whatever_the_gap(gap_s: int, brief: str) -> None:
    again, then = 1 + gap_s, 2 + 2 * gap_s
    text = (
        "WEBVTT\n\n00:00:00.000 --> 00:00:01.000\n \nload<00:00:00.500><c> it</c>\n\n"
        f"00:00:{again:02}.000 --> 00:00:{again:02}{brief[2:]}\nload it\n \n\n"
        f"00:{then // 60:02}:{then % 60:02}.000 --> 00:{then // 60:02}:{then % 60:02}.900\n"
        f"load it\nload<00:{then // 60:02}:{then % 60:02}.500><c> it</c>\n"
    )
    track = subtitles.read("vtt", text)
    assert [cue.text for cue in track.cues] == ["load it", "load it"]
    assert [cue.start_s for cue in track.cues] == [0, then]


def test_a_line_that_is_said_twice_stays_beside_a_brief_cue() -> None:
    times = (("00.000", "01.000"), ("01.000", "01.010"), ("01.010", "02.000"), ("02.000", "03.000"))
    cues = "".join(f"00:{a} --> 00:{b}\nGo\n\n" for a, b in times)
    track = subtitles.read("vtt", f"WEBVTT\n\n{cues}")
    assert [cue[:2] for cue in track.cues] == [(0, 1.01), (1.01, 0.99), (2, 1)]


SAID = "if a < b and c > d, I <3 it"


@pytest.mark.parametrize(
    ("form", "text"),
    [
        ("vtt", f"WEBVTT\n\n00:01.000 --> 00:02.000\n{escape(SAID, quote=False)}"),
        ("srv3", f'<timedtext><body><p t="1000" d="1000">{escape(SAID)}</p></body></timedtext>'),
        (
            "srv3",
            f'<transcript><text start="1">{escape(f"<b>{escape(SAID)}</b>")}</text></transcript>',
        ),
        ("json3", json.dumps({"events": [{"tStartMs": 1000, "segs": [{"utf8": SAID}]}]})),
    ],
)
def test_signs_in_speech_are_no_tags(form: str, text: str) -> None:
    assert [cue.text for cue in subtitles.read(form, text).cues] == [SAID]


@pytest.mark.parametrize(
    ("form", "text", "cues"),
    [
        ("srv3", '<p t="1000" d="1.7">a</p><p t="x" d="5">b</p><p t="3e3" d="nan">c</p>', "ac"),
        ("srv3", '<p t="1" d="9">a&#xD83C;</p><p t="2" d="9">&#0;b\x0b</p>', "ab"),
        ("json3", '{"tStartMs": 1.7, "segs": null}, {"tStartMs": 1, "segs": [{"utf8": "a"}]}', "a"),
        ("json3", '{"tStartMs": 1e999, "segs": [{"utf8": "b"}]}, {"segs": [{"utf8": "a"}]}', "a"),
        ("json3", '{"dDurationMs": NaN, "segs": [null, {"utf8": 5}, {"utf8": "a\\ud83c"}]}', "a"),
        (
            "json3",
            '{"tStartMs": "7", "aAppend": "x", "segs": [{"utf8": "a", "tOffsetMs": []}]}',
            "a",
        ),
    ],
)
def test_an_odd_value_costs_that_value(form: str, text: str, cues: str) -> None:
    whole = {
        "srv3": f"<timedtext><body>{text}</body></timedtext>",
        "json3": f'{{"events": [{text}]}}',
    }
    assert [cue.text.strip("\ufffd") for cue in subtitles.read(form, whole[form]).cues] == [*cues]


@pytest.mark.parametrize(
    ("form", "text"),
    [
        ("vtt", ""),
        ("vtt", "<html>"),
        ("vtt", "WEBVTT\n\n0:0 --> 1\nx"),
        ("srv3", '<timedtext format="3"><body><p t="1" d="2">cut o'),
        ("srv3", "<html/>"),
        ("srv3", "<transcript><text>no start</text></transcript>"),
        ("srv3", '<timedtext><body><p t="x">a</p></body></timedtext>'),
        ("json3", '{"events": [{"tStartMs": 0, "segs": [{"utf8": "a'),
        ("json3", "{}"),
        ("json3", "[]"),
        ("json3", '{"events": [{"tStartMs": "soon", "segs": [{"utf8": "a"}]}]}'),
    ],
)
def test_what_cannot_be_read_says_so(form: str, text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        subtitles.read(form, text)
