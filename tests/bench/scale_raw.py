"""Raw data of the paper's shape at any share of its size, in the raw log's own form: segments of
zstd frames, an envelope each. Run as a module.

    python -m tests.bench.scale_raw ROOT SHARE [youtube] [reddit] [wiki]    1 is the paper's size

`dumps` writes archive dumps for `kb reddit import`: every line is of the subreddit, as in a file of
one subreddit.

Texts have the frequencies of words in speech (Zipf's law over English words, function words first,
and invented ones); the words of the profile's keyword list stand among them as often as the paper's
pairs say: about 0.9 pairs a kept video. Each segment is drawn from its own seed, so the same share
gives the same bytes, and segments can be made side by side.
"""

import contextlib
import csv
import os
import random
import sys
import tomllib
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import orjson
import zstandard

from kb.core.config.profile import load_profile
from kb.schema.raw import raw, types
from kb.store.rawlog.rawlog import SUFFIX, compressor
from kb.youtube.parse.answers import FORMAT
from kb.youtube.ytdlp.subtitles import Cue, as_columns

SOURCES = ("youtube", "reddit", "wiki")
VIDEOS = 1_460_000  # listed; about half of them pass all stages
WORDS = 3_014  # a transcript: 2.2 billion words of 730 thousand kept videos
POSTS, COMMENTS = 340_000, 6_600_000
PHRASES = 1.5  # keywords spoken in a transcript; everyday words and neighbours make no pair

_ITEMS = 50  # videos an envelope
_THINGS = 100  # records an envelope of dumps or of a listing
_VIDEO_ANSWERS, _TRANSCRIPTS, _PAGES = 1_000, 2_500, 4_000  # envelopes a segment


class Part(NamedTuple):
    """One segment: its kind, its number, and which records (first, one past the last) it holds."""

    source: str
    kind: str
    number: int
    first: int
    after: int


def parts(share: float, sources: Iterable[str] = SOURCES) -> list[Part]:
    """The segments of a share."""
    videos, posts = round(VIDEOS * share), round(POSTS * share)
    plan = {
        "youtube": (
            ("videos", videos, _ITEMS * _VIDEO_ANSWERS),
            ("transcripts", videos, 2 * _TRANSCRIPTS),
        ),
        # Half of the posts come from dumps, half from the service.
        "reddit": (
            ("dumps", posts // 2, _PAGES),
            ("listings", posts - posts // 2, _PAGES),
            ("comments", posts - posts // 2, _PAGES),
        ),
    }
    return [
        Part(source, kind, number, first, min(first + size, total))
        for source in sources
        if source in plan
        for kind, total, size in plan[source]
        for number, first in enumerate(range(0, total, size), 1)
    ]


def make(root: Path, share: float, sources: Iterable[str] = SOURCES) -> None:
    """Write the raw data of a share below `root`."""
    from tests.bench import scale_wiki

    if "reddit" in sources:  # the key with which the authors' names were hashed
        (root / "state").mkdir(parents=True, exist_ok=True)
        (root / "state" / "reddit.key").write_text("5eed" * 16 + "\n")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        made = [pool.submit(write, root, part) for part in parts(share, sources)]
        pages = scale_wiki.parts(share) if "wiki" in sources else []
        made += [pool.submit(scale_wiki.write, root, part) for part in pages]
        for each in made:
            each.result()


def dumps(folder: Path, share: float) -> list[Path]:
    """Write archive dumps of the posts and comments that came from such; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    posts, comments = folder / "RS_2022-01.zst", folder / "RC_2022-01.zst"
    chance = random.Random("dumps")
    words = Words(chance.getrandbits(32))
    with _dump(posts) as of_posts, _dump(comments) as of_comments:
        for number in range(round(POSTS * share) // 2):
            found, count = _tree(number, chance, words)
            of_posts.write(_line(_post(number, count, chance, words), chance))
            for data, _ in found:
                of_comments.write(_line(data, chance))
    return [posts, comments]


@contextlib.contextmanager
def _dump(path: Path) -> Iterator[Any]:
    engine = zstandard.ZstdCompressor(
        compression_params=zstandard.ZstdCompressionParameters.from_level(3, window_log=27)
    )
    with path.open("wb") as file, engine.stream_writer(file) as out:
        yield out


def _line(data: dict[str, Any], chance: random.Random) -> bytes:
    """A thing as dumps have it: with the author's name."""
    if data["author"] != "[deleted]":
        name = f"person{chance.getrandbits(17)}"
        data = {**data, "author": name, "author_fullname": f"t2_{name[6:]}"}
    data = {key: value for key, value in data.items() if key != "replies"}
    return orjson.dumps({**data, "retrieved_on": data["created_utc"] + 500_000}) + b"\n"


def write(root: Path, part: Part) -> None:
    """Write one segment."""
    chance = random.Random(f"{part}")
    folder = root / "raw" / part.source / part.kind
    folder.mkdir(parents=True, exist_ok=True)
    engine = compressor()
    words = Words(chance.getrandbits(32))
    with (folder / f"{part.number:06d}-5eed0000{SUFFIX}").open("wb") as file:
        for envelope in _MAKERS[part.source, part.kind](part, chance, words):
            file.write(engine.compress(orjson.dumps(envelope) + b"\n"))


class Words:
    """Draws texts."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._known, self._bounds, self._phrases = _vocabulary()

    def some(self, count: int, phrases: float = 0.0) -> list[str]:
        """So many words by Zipf's law, with `phrases` keywords among them on average."""
        drawn = np.searchsorted(self._bounds, self._random.random(count))
        words: list[str] = self._known[np.minimum(drawn, len(self._known) - 1)].tolist()
        for _ in range(self._random.poisson(phrases)):
            place, which = self._random.integers((count, len(self._phrases)))
            words[place] = self._phrases[which]
        return words

    def text(self, count: int, phrases: float = 0.0) -> str:
        return " ".join(self.some(count, phrases))


@cache
def _vocabulary() -> tuple[Any, Any, list[str]]:
    """Words, the bounds of their shares, and the keywords."""
    profile = load_profile("minecraft")
    phrases = []
    for name in profile.section("pairs").keyword_files:
        with profile.resolve_file(name).open(encoding="utf-8") as file:
            lines = (line for line in file if not line.startswith("#"))
            phrases += [row["keyword"].lower() for row in csv.DictReader(lines, delimiter="\t")]
    taken = {word for phrase in phrases for word in phrase.split()}
    chance = random.Random(7)
    most = [*_function_words(), *_everyday()]
    common = [w for w in dict.fromkeys(most) if w not in taken and f"{w}s" not in taken]
    letters = "etaoinshrdlucmfwypvbgk"
    made = {
        "".join(chance.choices(letters, k=min(14, 3 + int(chance.expovariate(0.3)))))
        for _ in range(30_000)
    }
    known = np.array([*common, *sorted(made - taken - set(common))], object)
    shares = 1 / (np.arange(len(known)) + 2.7) ** 1.07
    return known, np.cumsum(shares / shares.sum()), phrases


def _function_words() -> list[str]:
    """Without these no text would be English to `kb pairs`."""
    import kb.pairs.quality as room

    path = Path(str(room.__file__)).with_name("data") / "en.toml"
    words: str = tomllib.loads(path.read_text(encoding="utf-8"))["function_words"]
    return words.split()


def _everyday() -> list[str]:
    import kb.core.config.section as module

    text = Path(str(module.__file__)).with_name("everyday_words.txt").read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    return " ".join(lines).split()


def _envelope(endpoint: str, params: dict[str, Any], response: Any, at: str | None) -> Any:
    return {
        "fetched_at": at,
        "request": {"endpoint": endpoint, "params": params},
        "status": 200,
        "response": response,
    }


# YouTube


def video_id(number: int) -> str:
    return f"{(number * 2654435761) % (1 << 40):010x}x"


def _videos(part: Part, chance: random.Random, words: Words) -> Iterator[Any]:
    for first in range(part.first, part.after, _ITEMS):
        numbers = range(first, min(first + _ITEMS, part.after))
        items = [_video(number, chance, words) for number in numbers]
        asked = ",".join(map(video_id, numbers))
        response = {
            "kind": "youtube#videoListResponse",
            "etag": "e",
            # A few of those that were asked for are gone.
            "items": [item for item in items if chance.random() > 0.003],
            "pageInfo": {"totalResults": len(items), "resultsPerPage": len(items)},
        }
        params = {"part": "snippet,contentDetails,statistics,status,player", "id": asked}
        yield _envelope("videos.list", params, response, "2026-11-20T12:00:00Z")


def _video(number: int, chance: random.Random, words: Words) -> dict[str, Any]:
    key, odd = video_id(number), chance.random()
    good = number % 2 == 0 and chance.random() < 0.98  # those that have a transcript
    title = words.text(8) + (" Minecraft guide" if chance.random() < 0.7 else "")
    description, tags = words.text(90), words.some(12)
    statistics = {
        "viewCount": str(int(10 ** (2 * good + chance.random() * (5 - 2 * good)))),
        "likeCount": str(chance.randrange(10_000)),
        "favoriteCount": "0",
        "commentCount": str(chance.randrange(300)),
    }
    if odd < 0.01:
        del statistics["likeCount"]
    elif odd < 0.012:
        statistics["viewCount"] = "-5"
    elif odd < 0.014:
        del statistics["viewCount"]
    tall = not good and chance.random() < 0.3
    sizes = {"default": 120, "medium": 320, "high": 480, "standard": 640, "maxres": 1280}
    length = f"PT{chance.randrange(good, 60)}M{chance.randrange(60)}S" if odd < 0.99 else "P0D"
    return {
        "kind": "youtube#video",
        "etag": "x" * 27,
        "id": key,
        "snippet": {
            "publishedAt": f"20{chance.randrange(10, 26)}-03-21T20:37:49Z",
            "channelId": f"UC{number % 5000:022d}",
            "title": title,
            "description": description,
            "thumbnails": {
                name: {
                    "url": f"https://i.ytimg.com/vi/{key}/{name}.jpg",
                    "width": width,
                    "height": width * 9 // 16,
                }
                for name, width in sizes.items()
            },
            "channelTitle": "a channel",
            "tags": tags,
            "categoryId": "20" if good else chance.choice(("20", "22", "24")),
            "liveBroadcastContent": "none",
            "localized": {"title": title, "description": description},
            "defaultAudioLanguage": "en",
        },
        "contentDetails": {
            "duration": length,
            "dimension": "2d",
            "definition": "hd",
            "caption": "false",
            "licensedContent": True,
            "contentRating": {"ytRating": "ytAgeRestricted"} if odd < 0.005 else {},
            "projection": "rectangular",
        },
        "status": {
            "uploadStatus": "processed",
            "privacyStatus": "public",
            "license": "youtube",
            "embeddable": True,
            "publicStatsViewable": True,
            "madeForKids": False,
        },
        "statistics": statistics,
        "player": {
            "embedHtml": "<iframe></iframe>",
            "embedWidth": "405" if tall else "854",
            "embedHeight": "720" if tall else "480",
        },
    }


def _transcripts(part: Part, chance: random.Random, words: Words) -> Iterator[Any]:
    """Of every second video, as only those are asked for that pass the cheap stages."""
    for number in range(part.first, part.after, 2):
        outcome = "ok" if chance.random() < 0.93 else chance.choice(("none", "disabled"))
        made = _spoken(chance, words) if outcome == "ok" else {"cues": None}
        response = {
            "format": FORMAT,
            "video_id": video_id(number),
            "outcome": outcome,
            "reason": None if outcome == "ok" else "no transcript",
            "kind": None,
            "language": None,
            "original_kind": None,
            **made,
            "player": {
                "width": 1920,
                "height": 1080,
                "fps": 30,
                "length_s": 600,
                "game_label_id": "UCQvWX73GQygcwXOTSf_VDVg" if chance.random() < 0.95 else None,
                "game_label": "Minecraft",
                "playability": "OK",
                "reason": None,
                "tracks": [{"language": "en", "kind": "asr"}],
            },
        }
        params = {"video_id": video_id(number), "language": "en"}
        yield _envelope("transcript", params, response, "2026-11-21T12:00:00Z")


def _spoken(chance: random.Random, words: Words) -> dict[str, Any]:
    count = min(60_000, max(20, int(chance.lognormvariate(7.6, 0.9))))  # mean: WORDS
    said = words.some(count, PHRASES * count / WORDS)
    automatic = chance.random() < 0.85
    cues, place, at = [], 0, 0.0
    while place < count:
        size = chance.randint(4, 11)
        length = round(size * 0.41 + chance.random(), 2)
        text = " ".join(said[place : place + size])
        odd = chance.random()  # as in real tracks: music, an apostrophe that is no ASCII, two lines
        if odd < 0.04:
            text = ("[Music]", "♪ " + text + " ♪", text.replace(" ", "’s ", 1))[int(odd * 75)]
        elif not automatic:
            text = text.replace(" ", "\n", 1)
        cue: list[Any] = [round(at, 2), length, text]
        if automatic:  # real automatic tracks have the time of each word
            times = [round(at + 0.38 * word, 3) for word in range(len(text.split()))]
            cue.append(times)
        cues.append(Cue(*cue))
        place, at = place + size, at + size * 0.38
    kind = "asr" if automatic else "manual"
    return {"kind": kind, "language": "en", "original_kind": kind, "cues": as_columns(cues)}


# Reddit


@cache
def _blank(kind: str) -> dict[str, Any]:
    """The fields of a thing that say nothing, as an answer of today lists them."""
    fields = raw("reddit/listings")["properties"]["data"]["properties"]["children"]["items"]
    fields = fields["properties"]["data"]["properties"]
    of_posts = ("link_flair", "media", "thumbnail", "url", "is_", "whitelist", "num_", "secure")
    empty: dict[str, Any] = {"boolean": False, "integer": 0, "array": [], "object": {}}
    made: dict[str, Any] = {}
    for name, schema in fields.items():
        if "<" in name or (kind == "t1" and name.startswith(of_posts)):
            continue
        known = sorted(types(schema) - {"null"})
        made[name] = empty.get(known[0]) if known else None
    for name in ("gallery_data", "poll_data", "crosspost_parent_list", "is_gallery", "preview"):
        made.pop(name, None)
    for name in ("selftext", "title") if kind == "t1" else ("body", "replies", "link_id"):
        made.pop(name, None)
    for name in ("children", "_meta", "retrieved_on", "retrieved_utc", "is_robot_indexable"):
        made.pop(name, None)
    return made


def _post(number: int, comments: int, chance: random.Random, words: Words) -> dict[str, Any]:
    key, title = f"p{number:x}", words.text(9)
    page = f"/r/Minecraft/comments/{key}/{title.replace(' ', '_')[:40]}/"
    own = chance.random() < 0.35
    url = f"https://www.reddit.com{page}" if own else f"https://i.redd.it/{key}.jpg"
    gone = chance.random() < 0.05
    return {
        **_blank("t3"),
        "id": key,
        "name": f"t3_{key}",
        "subreddit": "Minecraft",
        "subreddit_id": "t5_2r05i",
        "title": title,
        "author": f"{chance.getrandbits(17):032x}",
        "author_fullname": f"{chance.getrandbits(17):032x}",
        "selftext": "[deleted]" if gone else words.text(chance.randint(5, 120)) if own else "",
        "is_self": own,
        "is_video": False,
        "is_robot_indexable": not gone,
        "over_18": chance.random() < 0.01,
        "url": url,
        "permalink": page,
        "domain": "self.Minecraft" if own else "i.redd.it",
        "created_utc": 1_600_000_000 + number * 37,
        "score": int(chance.expovariate(1 / 40)),
        "upvote_ratio": round(0.5 + chance.random() / 2, 2),
        "num_comments": comments,
    }


def _comment(
    post: int, number: int, parent: str, chance: random.Random, words: Words
) -> dict[str, Any]:
    key = f"c{post:x}x{number:x}"
    gone = chance.random() < 0.04
    return {
        **_blank("t1"),
        "id": key,
        "name": f"t1_{key}",
        "link_id": f"t3_p{post:x}",
        "parent_id": parent,
        "subreddit": "Minecraft",
        "subreddit_id": "t5_2r05i",
        "author": "[deleted]" if gone else f"{chance.getrandbits(17):032x}",
        "author_fullname": f"{chance.getrandbits(17):032x}",
        "body": "[deleted]" if gone else words.text(1 + int(chance.expovariate(1 / 25))),
        "created_utc": 1_600_000_000 + post * 37 + number * 61,
        "score": int(chance.expovariate(1 / 4)) - 1,
        "permalink": f"/r/Minecraft/comments/p{post:x}/x/{key}/",
        "replies": "",
        "depth": 0,
    }


def _tree(
    post: int, chance: random.Random, words: Words
) -> tuple[list[tuple[dict[str, Any], int]], int]:
    """Comments of a post, parents first, each with the place of its parent (-1: the post)."""
    count = int(chance.expovariate(POSTS / COMMENTS))
    found: list[tuple[dict[str, Any], int]] = []
    for number in range(count):
        above = chance.randrange(len(found)) if found and chance.random() < 0.5 else -1
        parent = f"t3_p{post:x}" if above < 0 else found[above][0]["name"]
        found.append((_comment(post, number, parent, chance, words), above))
    return found, count


def _thing(kind: str, data: dict[str, Any]) -> dict[str, Any]:
    return {"kind": kind, "data": data}


def _listing(children: list[Any]) -> dict[str, Any]:
    data = {"after": None, "dist": len(children), "modhash": "", "geo_filter": ""}
    return {"kind": "Listing", "data": {**data, "children": children, "before": None}}


def _dumps(part: Part, chance: random.Random, words: Words) -> Iterator[Any]:
    offset = 0
    waiting: list[Any] = []
    for number in range(part.first, part.after):
        found, count = _tree(number, chance, words)
        for kind, data in (
            ("t3", _post(number, count, chance, words)),
            *(("t1", comment) for comment, _ in found),
        ):
            data.pop("replies", None)
            waiting.append(_thing(kind, {**data, "retrieved_on": data["created_utc"] + 500_000}))
        while len(waiting) >= _THINGS or (waiting and number == part.after - 1):
            offset += 250_000
            response = {"kind": "Listing", "data": {"children": waiting[:_THINGS]}}
            waiting = waiting[_THINGS:]
            name = f"dump/RS_{2012 + part.number % 10}-01.zst"
            yield _envelope(name, {"offset": offset}, response, "2022-11-21T18:13:40Z")


def _live(part: Part) -> int:
    """Numbers of posts that the service shows follow those of the dumps."""
    return 1 << 24 | part.first


def _listings(part: Part, chance: random.Random, words: Words) -> Iterator[Any]:
    start = _live(part)
    for first in range(start, start + part.after - part.first, _THINGS):
        after = min(first + _THINGS, start + part.after - part.first)
        made = [_thing("t3", _post(n, 0, chance, words)) for n in range(first, after)]
        params = {"limit": 100, "raw_json": 1}
        yield _envelope("r/Minecraft/new", params, _listing(made), "2026-11-20T12:00:00Z")


def _comments(part: Part, chance: random.Random, words: Words) -> Iterator[Any]:
    for number in range(_live(part), _live(part) + part.after - part.first):
        found, count = _tree(number, chance, words)
        things = [_thing("t1", data) for data, _ in found]
        top = []
        for thing, (_, above) in zip(things, found, strict=True):
            if above < 0:
                top.append(thing)
                continue
            under = things[above]["data"]
            if not under["replies"]:
                under["replies"] = _listing([])
            thing["data"]["depth"] = under["depth"] + 1
            under["replies"]["data"]["children"].append(thing)
        post = _thing("t3", _post(number, count, chance, words))
        key = f"p{number:x}"
        params = {"limit": 500, "sort": "old", "raw_json": 1, "article": key}
        response = [_listing([post]), _listing(top)]
        yield _envelope(f"comments/{key}", params, response, "2026-11-20T13:00:00Z")


_MAKERS = {
    ("youtube", "videos"): _videos,
    ("youtube", "transcripts"): _transcripts,
    ("reddit", "dumps"): _dumps,
    ("reddit", "listings"): _listings,
    ("reddit", "comments"): _comments,
}


if __name__ == "__main__":
    make(Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3:] or SOURCES)
