"""Video ids from a list, and which video or playlist an address of YouTube names.

An address counts by its host, its path and the one parameter that the path asks for. Other
parameters may hold anything that looks like an id (`ab_channel=KilnRoad123`), in any order; the
address of a channel or a search names no video, and neither does any other host.

    watch?v=ID, watch/ID           also without `www.`, on m., music., gaming. and other subdomains
    shorts/ID, live/ID, embed/ID, v/ID, e/ID, vi/ID/0.jpg, video/ID/edit
    youtu.be/ID
    attribution_link?u=…, oembed?url=…      the address that is encoded in it
    #/watch?v=ID, watch#!v=ID               as old pages of the site wrote it
    playlist?list=ID                        a playlist; what `watch` names is the video
"""

import re
from collections.abc import Iterable
from urllib.parse import parse_qs, unquote, urlsplit

from kb.crawl.id_list import IdRules, ListedId

_ID = re.compile(r"[A-Za-z0-9_-]{11}")
_PLAYLIST = re.compile(  # not uploads, likes, a list to watch later and mixes, which nobody made
    r"(?!UU|UC|LL|WL|RD|UL)[A-Za-z0-9_-]{12,64}"
)
_FIRST = re.compile(r"([A-Za-z0-9_-]{11})(?![A-Za-z0-9_-])")  # people add "?t=30" behind anything
_ARCHIVED = re.compile(r"youtube ([A-Za-z0-9_-]{11})")  # a line of yt-dlp's download archive
_OF_DATA_SET = re.compile(  # ActivityNet's names, and those of clips in Kinetics and VATEX
    r"v_([A-Za-z0-9_-]{11})|([A-Za-z0-9_-]{11})_\d{6}_\d{6}"
)
_WORD = re.compile(r"[A-Za-z]?[a-z]{10}")
_BULLET = re.compile(r"(?:[-*•]|\d+[.)])\s+")
_PLAIN = re.compile(  # most addresses of most lists; the long way takes many times as long
    r"https://(?:www\.youtube\.com/watch\?v=|youtu\.be/)([A-Za-z0-9_-]{11})"
)
_SCHEME = re.compile(r"(?:https?:)?//", re.IGNORECASE)
_HOSTS = (
    "youtube.com",
    "youtube-nocookie.com",
    "youtubeeducation.com",
    "youtubekids.com",
    "youtube.googleapis.com",
    "ytimg.com",
)
_SHORT = "youtu.be"
_BY_PATH = {"watch", "shorts", "live", "embed", "v", "e", "vi", "vi_webp", "video"}
_BY_QUERY = {"", "watch", "watch.php", "watch_popup", "movie", "details", "live_chat", "tv"}
_INSIDE = {"attribution_link": "u", "oembed": "url", "signin": "next", "m": "continue"}
_LISTS = {"videoseries", "live_stream"}  # embed/videoseries?list=…: as long as an id, and none
_AROUND = " \t\r\n<>\"'(),;."  # what people write around an address; no id has it


def video_of(text: str) -> str | None:
    """The id of the video that a text names: an id, an address, a line of yt-dlp's archive, or
    words around one address. None for none, and for several.
    """
    text = re.sub(r"\s#.*", "", text).strip(_AROUND)
    if bullet := _BULLET.match(text):
        text = text[bullet.end() :]
    if _ID.fullmatch(text):
        return text
    if plain := _PLAIN.fullmatch(text):
        return _id(plain[1])
    if named := _OF_DATA_SET.fullmatch(text):
        return named[1] or named[2]
    if archived := _ARCHIVED.fullmatch(text):
        return archived[1]
    words = text.replace("](", " ").split()  # a link of Markdown
    videos = {video_of_address(word.strip(_AROUND)) for word in words} - {None}
    return videos.pop() if len(videos) == 1 else None


def is_unmistakable(text: str) -> bool:
    """Whether a text names a video, and is no word of eleven letters."""
    text = text.strip(_AROUND)
    if _ID.fullmatch(text):
        return not _WORD.fullmatch(text)
    return _OF_DATA_SET.fullmatch(text) is not None or video_of_address(text) is not None


def video_of_address(address: str) -> str | None:
    """The id of the video that an address names, with or without a scheme; None for none."""
    scheme = _SCHEME.match(address)
    rest = address[scheme.end() :] if scheme else address
    try:
        parts = urlsplit(f"https://{rest}".replace("&amp;", "&"))
        host = (parts.hostname or "").rstrip(".")
    except ValueError:  # brackets that are no IPv6 address
        return None
    if host in (_SHORT, f"www.{_SHORT}"):
        return _of_path(parts.path, parts.query, "", short=True)
    if _is_own(host):
        return _of_path(parts.path, parts.query, parts.fragment)
    return None


def _of_path(path: str, query: str, fragment: str, *, short: bool = False) -> str | None:
    first, *others = [unquote(part) for part in path.split("/") if part] or [""]
    if short and (video := _id(first)):  # also where it spells a page's name
        return video
    kind = first.lower()
    if kind in _INSIDE:
        return _of_inside(parse_qs(query).get(_INSIDE[kind], []))
    if kind in _BY_PATH and others:
        return _id(others[0])
    if kind in _BY_QUERY:
        inner = fragment.removeprefix("!")
        if video := _of_query(query):
            return video
        if inner.startswith("/"):
            parts = urlsplit(inner)
            return _of_path(parts.path, parts.query, "")
        return _of_query(inner)
    return None


def _of_query(query: str) -> str | None:
    named = {_id(value) for value in parse_qs(query).get("v", [])} - {None}
    return named.pop() if len(named) == 1 else None


def _of_inside(addresses: list[str]) -> str | None:
    """The video of an address in a parameter, which may leave out the host."""
    for address in addresses:
        if address.startswith("/") and not address.startswith("//"):
            parts = urlsplit(address)
            return _of_path(parts.path, parts.query, "")
        return video_of_address(address)
    return None


def _id(text: str) -> str | None:
    match = _FIRST.match(text.strip())
    return match[1] if match and match[1] not in _LISTS else None


"""Which of how many machines, from 1; None for one that does it all."""


def playlist_of(text: str) -> str | None:
    """The id of the playlist that an address names, or that a text is; None for none."""
    text = text.strip(_AROUND)
    if text.startswith("PL") and _PLAYLIST.fullmatch(text):
        return text
    scheme = _SCHEME.match(text)
    try:
        parts = urlsplit(f"https://{text[scheme.end() :] if scheme else text}")
        host = (parts.hostname or "").rstrip(".")
    except ValueError:
        return None
    named = parse_qs(parts.query).get("list", [])
    if not _is_own(host) or parts.path.strip("/").lower() != "playlist" or len(named) != 1:
        return None
    return named[0] if _PLAYLIST.fullmatch(named[0]) else None


def _is_own(host: str) -> bool:
    return any(host == own or host.endswith(f".{own}") for own in _HOSTS)


def sorted_by_form(keys: Iterable[str]) -> tuple[list[str], list[str]]:
    """The ids of videos and those of playlists among these."""
    forms: tuple[list[str], list[str]] = ([], [])
    for key in keys:
        forms[_ID.fullmatch(key) is None].append(key)
    return forms


def parse(entry: ListedId) -> str | None:
    """The video that an entry of a list names, else the playlist."""
    value = entry.value
    return (video_of(value) or playlist_of(value)) if isinstance(value, str) else None


RULES = IdRules(
    option="--ids",
    noun="video ids",
    hint="write one per line: 11 characters, or the URL of a video or of a playlist",
    columns=(
        "video_id",
        "youtube_id",
        "vid",
        "id",
        "key",
        "video_url",
        "youtube_url",
        "title_url",
        "webpage_url",
        "original_url",
        "url",
        "link",
    ),
    tables=(("videos",), ("pairs",)),
    parse=parse,
    is_unmistakable=is_unmistakable,
)
