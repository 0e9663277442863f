"""Files as yt-dlp writes them, made of lines: what YouTube answers for one track in its four forms.

An automatic track is shown in a window of two rows: a line is followed 10 ms before the next one by
a line break of its own, and stays until the line after the next.
"""

import json
from html import escape
from pathlib import Path
from typing import Any, NamedTuple


class Line(NamedTuple):
    """A line of a track: ms, and its words with their offsets (None: a manual line's text)."""

    start: int
    length: int
    words: list[tuple[int, str]]

    @property
    def text(self) -> str:
        return "".join(word for _, word in self.words)

    @property
    def end(self) -> int:
        return self.start + self.length


def spoken(*texts: str, start: int = 320, word_ms: int = 240, pause_after: int = -1) -> list[Line]:
    """An automatic track: lines that follow each other, each shown until the one after the next;
    after line `pause_after` nobody speaks for five seconds.
    """
    starts, at = [], start
    for number, text in enumerate(texts):
        starts.append(at)
        at += word_ms * len(text.split()) + 10 + 5_000 * (number == pause_after)
    lines = []
    for number, text in enumerate(texts):
        words = text.split()
        end = starts[number + 2] if number + 2 < len(starts) else at
        if number == pause_after:
            end = starts[number] + word_ms * len(words) + 100
        if number + 1 == pause_after:
            end = min(end, starts[number + 1] + word_ms * len(texts[number + 1].split()))
        spaced = [word if place == 0 else f" {word}" for place, word in enumerate(words)]
        offsets = [word_ms * place for place in range(len(words))]
        lines.append(
            Line(starts[number], end - starts[number], list(zip(offsets, spaced, strict=True)))
        )
    return lines


def srv3(lines: list[Line], *, automatic: bool) -> str:
    """`.srv3`."""
    made = []
    for number, line in enumerate(lines):
        if not automatic:
            made.append(f'<p t="{line.start}" d="{line.length}">{escape(line.text)}</p>')
            continue
        if number:
            made.append(f'<p t="{line.start - 10}" d="10" w="1" a="1">\n</p>')
        if len(line.words) == 1 and line.text.startswith("["):
            words = escape(line.text)
        else:
            words = "".join(
                f'<s ac="0">{escape(word)}</s>'
                if not offset
                else f'<s t="{offset}" ac="0">{escape(word)}</s>'
                for offset, word in line.words
            )
        made.append(f'<p t="{line.start}" d="{line.length}" w="1">{words}</p>')
    window = '<w t="0" id="1" wp="1" ws="1"/>\n' if automatic else ""
    body = "\n".join(made)
    return (
        '<?xml version="1.0" encoding="utf-8" ?><timedtext format="3">\n<head>\n<ws id="0"/>\n'
        f"</head>\n<body>\n{window}{body}\n</body>\n</timedtext>\n"
    )


def json3(lines: list[Line], *, automatic: bool) -> str:
    """`.json3`."""
    events: list[dict[str, Any]] = []
    if automatic:
        whole = lines[-1].end if lines else 0
        events.append(
            {"tStartMs": 0, "dDurationMs": whole, "id": 1, "wpWinPosId": 1, "wsWinStyleId": 1}
        )
    for number, line in enumerate(lines):
        if automatic and number:
            break_ = {"wWinId": 1, "aAppend": 1, "segs": [{"utf8": "\n"}]}
            events.append({"tStartMs": line.start - 10, "dDurationMs": 10, **break_})
        segments: list[dict[str, Any]] = []
        for offset, word in line.words:
            timed = {"tOffsetMs": offset} if offset else {}
            rated = {"acAsrConf": 0} if automatic else {}
            segments.append({"utf8": word, **timed, **rated})
        events.append({"tStartMs": line.start, "dDurationMs": line.length, "segs": segments})
    return json.dumps({"wireMagic": "pb3", "pens": [{}], "events": events}, indent=2)


def vtt(lines: list[Line], *, automatic: bool, words: bool = True) -> str:
    """`.vtt`; `words` False: the rolling display of a translated track, without times of words."""
    cues: list[tuple[int, int, list[str]]] = []
    for number, line in enumerate(lines):
        if not automatic:
            cues.append((line.start, line.end, _vtt_text(line.text).split("\n")))
            continue
        before = lines[number - 1] if number else None
        above = before.text if before is not None and before.end > line.start else " "
        after = lines[number + 1].start if number + 1 < len(lines) else line.end + 10
        until = min(line.end, after - 10)
        cues.append((line.start, until, [_vtt_text(above), _marked(line) if words else line.text]))
        if line.end > after - 10 and number + 1 < len(lines):
            cues.append((after - 10, after, [_vtt_text(line.text), " "]))
    placed = " align:start position:0%" if automatic else ""
    blocks = [
        "\n".join([f"{_time(start)} --> {_time(end)}{placed}", *rows]) for start, end, rows in cues
    ]
    return "\n\n".join(["WEBVTT\nKind: captions\nLanguage: en", *blocks]) + "\n\n"


def _marked(line: Line) -> str:
    first, *others = line.words
    return _vtt_text(first[1]) + "".join(
        f"<{_time(line.start + offset)}><c>{_vtt_text(word)}</c>" for offset, word in others
    )


def _vtt_text(text: str) -> str:
    return escape(text, quote=False)


def _time(ms: int) -> str:
    seconds, ms = divmod(ms, 1000)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}.{ms:03}"


FORMS = {"vtt": vtt, "srv3": srv3, "json3": json3}


def info(video_id: str, **changes: Any) -> dict[str, Any]:
    """An info.json with all that is looked at, and signed addresses that must not be kept."""
    address = f"https://signed.example/videoplayback?id={video_id}&ip=203.0.113.7&sig=SECRET"
    track = [{"ext": "json3", "url": f"{address}&fmt=json3", "name": "English"}]
    found = {
        "id": video_id,
        "title": f"Building a minecraft farm {video_id}",
        "formats": [
            {"format_id": "sb0", "width": 48, "height": 27, "fps": 0.5, "url": address},
            {"format_id": "140", "acodec": "mp4a", "vcodec": "none", "url": address},
            {"format_id": "136", "width": 1280, "height": 720, "fps": 30, "url": address},
            {"format_id": "299", "width": 1920, "height": 1080, "fps": 60, "url": address},
        ],
        "thumbnail": f"https://img.example/{video_id}.jpg",
        "description": "How to build a farm in minecraft.",
        "channel_id": "UCxxxxxxxxxxxxxxxxxxxxxx",
        "duration": 321,
        "view_count": 54_321,
        "average_rating": None,
        "age_limit": 0,
        "webpage_url": f"https://www.youtube.com/watch?v={video_id}",
        "categories": ["Gaming"],
        "tags": ["minecraft", "farm"],
        "playable_in_embed": True,
        "live_status": "not_live",
        "media_type": "video",
        "release_timestamp": None,
        "automatic_captions": {"en-orig": track, "en": track, "de": track},
        "subtitles": {},
        "comment_count": 12,
        "chapters": [{"start_time": 0.0, "title": "Intro", "end_time": 20.0}],
        "like_count": 1_234,
        "channel": "A channel",
        "uploader": "A channel",
        "uploader_id": "@channel",
        "upload_date": "20240131",
        "timestamp": 1_706_700_000,
        "availability": "public",
        "extractor": "youtube",
        "extractor_key": "Youtube",
        "http_headers": {"Cookie": "VISITOR_INFO1_LIVE=SECRET"},
        "language": "en",
        "width": 640,
        "height": 360,
        "fps": 30,
        "epoch": 1_790_000_000,
        "_type": "video",
        "_version": {"version": "2026.08.01", "repository": "yt-dlp/yt-dlp"},
    }
    return {**found, **changes}


def video_id(number: int) -> str:
    """An id that no video of YouTube has: they end in one of sixteen letters, none of them 1."""
    return f"test{number:06d}1"


def write_video(
    folder: Path, number: int, forms: tuple[str, ...] = ("vtt",), **changes: Any
) -> str:
    """`TITLE [ID].info.json`, a thumbnail and an automatic English track in the forms given."""
    folder.mkdir(parents=True, exist_ok=True)
    key = video_id(number)
    stem = f"Title {number} [{key}]"
    (folder / f"{stem}.info.json").write_text(json.dumps(info(key, **changes)), encoding="utf-8")
    (folder / f"{stem}.webp").write_bytes(b"RIFF")
    (folder / f"{stem}.mkv").write_bytes(b"\x1aE\xdf\xa3")
    track = spoken(
        "so today we build a farm", "with a water bucket and", "a piston", "and that's it"
    )
    for form in forms:
        text = FORMS[form](track, automatic=True)
        (folder / f"{stem}.en.{form}").write_text(text, encoding="utf-8")
    return key
