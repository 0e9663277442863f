"""One post or comment, live or from a dump of any year → a row as a plain dictionary.

HTML entities of a dump's record are resolved once for the whole record. What a post is, its content
says and not one unreliable hint (`post_hint` lacks on many). A value that can't be read is null,
and the list `problems` of its row says why: (column, reason, value).
"""

import hashlib
import html
import json
import re
from collections.abc import Callable, Iterable, Mapping
from html.entities import html5
from typing import Any
from urllib.parse import urlsplit

from kb.reddit.parse import answer_tree
from kb.reddit.parse.answer_tree import PURGED
from kb.reddit.parse.removal import LATEST, flag, removal, retrieved
from kb.reddit.section import Links

Post = Mapping[str, Any]
_SUBDOMAINS = ("www.", "m.", "old.", "new.", "i.")
_KINDS = {"image": "image", "video": "video", "general": "link"}


def link_classifier(links: Links) -> Callable[[str], str]:
    """A function from an address to "image", "video" or "general", by the profile's table.

    Endings of the path decide first (imgur's `.gifv` is a video, its `.gif` an image), then hosts.
    """
    image_hosts, video_hosts = frozenset(links.image_hosts), frozenset(links.video_hosts)
    image_endings, video_endings = frozenset(links.image_endings), frozenset(links.video_endings)

    def classify(address: str) -> str:
        try:
            parts = urlsplit(address)
            host = (parts.hostname or "").lower()
        except ValueError:
            return "general"
        names = {host, *(host.removeprefix(sub) for sub in _SUBDOMAINS)}
        ending = (
            parts.path.rpartition("/")[2].rpartition(".")[2].lower() if "." in parts.path else ""
        )
        if ending in video_endings or names & video_hosts:
            return "video"
        if ending in image_endings or names & image_hosts:
            return "image"
        for name in names:
            # "/" alone stands for any page but the front page
            if any(
                parts.path.startswith(start) and parts.path != "/"
                for start in links.video_paths.get(name, ())
            ):
                return "video"
        return "general"

    return classify


def origin(post: Post) -> Post:
    """The post that a crosspost shows: its parent where the answer holds it, else itself."""
    parents = post.get("crosspost_parent_list")
    return (
        parents[0]
        if isinstance(parents, list) and parents and isinstance(parents[0], dict)
        else post
    )


def is_crosspost(post: Post) -> bool:
    return bool(post.get("crosspost_parent") or post.get("crosspost_parent_list"))


def post_type(post: Post, classify: Callable[[str], str]) -> tuple[str, str | None, str | None]:
    """(type, link_kind, source_url) of a post of any year.

    Types: gallery, poll, text, image, video, link. `link_kind` (image, video, general) is for
    posts that link, null for text, polls and galleries. A post whose content is gone (`url` is
    its own page, or absent) counts as text.
    """
    true = origin(post)
    url = true.get("url_overridden_by_dest") or true.get("url")
    url = url if isinstance(url, str) and url else None
    if true.get("is_gallery") or true.get("gallery_data"):
        return "gallery", None, url
    if true.get("poll_data"):
        return "poll", None, None
    page = true.get("permalink")
    is_own_page = isinstance(page, str) and len(page) > 1 and url is not None and url.endswith(page)
    if true.get("is_self") or url is None or is_own_page:
        return "text", None, None
    if "reddit.com/gallery/" in url or url.startswith("/gallery/"):
        return "gallery", None, url
    parent = post.get("crosspost_parent")
    parents_page = f"/comments/{str(parent).removeprefix('t3_')}/"
    if true is post and parent and parents_page in f"{url}/":
        # Of a crosspost without its parent: the address of a text is its page.
        return "text", None, None
    kind = "video" if true.get("is_video") else classify(url)
    return _KINDS[kind], kind, url


def poll_options(post: Post) -> list[str] | None:
    """Texts of a poll's options, in order; None when the post is no poll."""
    poll = origin(post).get("poll_data")
    if not isinstance(poll, dict):
        return None
    options = poll.get("options")
    return (
        [
            str(text)
            for option in options
            if isinstance(option, dict) and (text := option.get("text")) not in (None, "")
        ]
        if isinstance(options, list)
        else []
    )


_TEXTS = ("title", "selftext", "body")  # what tells whether a record was escaped
_ADDRESSES = ("url", "url_overridden_by_dest")
_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
_LARGEST = 1 << 62
_LARGEST_ID = 36**13  # as for ids in lists
_WHOLE = re.compile(r"[0-9]{1,25}(?:\.0+)?")
_NUMBER = re.compile(r"#(?:[0-9]+|[xX][0-9a-fA-F]+)")
_OF_REDDIT = ("&amp;", "&lt;", "&gt;")


def unescaped(text: str) -> str:
    """The only text of a record (a comment's body) with its entities resolved, unless it was never
    escaped.
    """
    return text if "&" not in text or was_never_escaped((text,)) else html.unescape(text)


def was_never_escaped(texts: Iterable[str]) -> bool:
    """Whether one of a record's texts holds what escaping would have replaced."""
    return any("<" in text or ">" in text or _holds_bare(text) for text in texts)


def _holds_bare(text: str) -> bool:
    number = text.count("&")
    if not number or number == sum(map(text.count, _OF_REDDIT)):
        return False
    return not all(map(_begins_entity, text.split("&")[1:]))


def _begins_entity(behind: str) -> bool:
    """Whether an ampersand with this behind it begins an entity."""
    name, end, _ = behind.partition(";")
    return bool(end) and (f"{name};" in html5 or _NUMBER.fullmatch(name) is not None)


def resolve(record: dict[str, Any]) -> dict[str, Any]:
    """The fields of a post or comment of a dump with their entities resolved; the same object where
    nothing changes.

    The post that a crosspost shows is a record of its own. An address that holds a bare `&` stays.
    """
    texts = [text for name in _TEXTS if isinstance(text := record.get(name), str)]
    if was_never_escaped(texts):
        return record
    changed: dict[str, Any] = {
        name: html.unescape(text) if name in _TEXTS else unescaped(text)
        for name in (*_TEXTS, *_ADDRESSES)
        if isinstance(text := record.get(name), str) and "&" in text
    }
    parents = record.get("crosspost_parent_list")
    if isinstance(parents, list) and parents and isinstance(parents[0], dict):
        changed["crosspost_parent_list"] = [resolve(parents[0]), *parents[1:]]
    poll = record.get("poll_data")
    if isinstance(poll, dict) and isinstance(poll.get("options"), list):
        options = [
            {**option, "text": html.unescape(text)} if isinstance(text, str) else option
            for option in poll["options"]
            if isinstance(option, dict)
            for text in [option.get("text")]
        ]
        changed["poll_data"] = {**poll, "options": options}
    return {**record, **changed} if changed else record


Row = dict[str, Any]
NOBODY = frozenset({"", "[deleted]", "[removed]", PURGED})  # names that stand for no author
_COLUMNS = {"selftext": "body"}  # fields whose column has another name


class RecordReader:
    """Reads the records of one kind of answers. Only dumps hold HTML entities."""

    def __init__(self, links: Links, *, live: bool) -> None:
        self._live = live
        self._classify: Callable[[str], str] = link_classifier(links)

    def post(self, data: dict[str, Any]) -> Row:
        """The row of a post (a submission's fields of any year)."""
        if not self._live:
            data = resolve(data)
        row = _identified(answer_tree.POST, data)
        row["post_id"] = row["fullname"].partition("_")[2]
        row["type"], row["link_kind"], row["source_url"] = post_type(data, self._classify)
        row["is_crosspost"] = is_crosspost(data)
        row["poll_options"] = poll_options(data)
        row["over_18"] = _flag(row, data, "over_18")
        row["title"] = _text(row, data, "title", required=True)
        row["text"] = _text(row, data, "selftext") or None
        row["num_comments"] = _integer(row, data, "num_comments")
        row["upvote_ratio"] = _ratio(row, data, "upvote_ratio")
        return _with_common(row, data)

    def comment(self, data: dict[str, Any]) -> Row:
        """The row of a comment."""
        if not self._live:
            data = resolve(data)
        row = _identified(answer_tree.COMMENT, data)
        row["post_id"] = answer_tree.bare(data.get("link_id"))
        parent = data.get("parent_id", "")
        if isinstance(parent, str) and parent.startswith(("t1_", "t3_")):
            row["parent_id"] = parent
        elif parent is None and row["post_id"]:  # dumps of 2024 and later: null is the post
            row["parent_id"] = f"{answer_tree.POST}_{row['post_id']}"
        elif (key := _base36(parent)) is not None:  # and a number is a comment
            row["parent_id"] = f"{answer_tree.COMMENT}_{key}"
        else:
            _problem(row, "parent_id", parent or None)
        row["text"] = _text(row, data, "body", required=True)
        return _with_common(row, data)


def new_row(fullname: str, post: str, state: str) -> Row:
    return {"fullname": fullname, "post_id": post, "state": state, "problems": []}


def _identified(kind: str, data: dict[str, Any]) -> Row:
    """A row under the record's id. A record without an id gets a key made of its content and the
    state `unknown`; the filter rejects it.
    """
    key = data.get("id")
    if isinstance(key, str) and key:
        return new_row(f"{kind}_{key}", "", "there")
    content = json.dumps(data, sort_keys=True, default=str).encode()
    row = new_row(f"{kind}_unknown-{hashlib.sha256(content).hexdigest()[:16]}", "", "unknown")
    _problem(row, "state", key)
    return row


def _with_common(row: Row, data: dict[str, Any]) -> Row:
    """The columns that posts and comments share."""
    row["retrieved"] = retrieved(data)
    row["score"] = _integer(row, data, "score")
    made = _integer(row, data, "created_utc")
    if made is not None and not 0 <= made < LATEST:
        _problem(row, "created_utc", data["created_utc"])
        made = None
    row["created_utc"] = made
    author = data.get("author")
    row["author_hash"] = author if isinstance(author, str) and author not in NOBODY else None
    if why := removal(data):
        row["gone"], row["gone_value"], row["undated"] = why.reason, why.value, not why.dated
    return row


def _problem(row: Row, column: str, value: Any) -> None:
    """Note that a value is absent or can't be read."""
    reason = "absent" if value is None else "malformed"
    row["problems"].append((column, reason, None if value is None else str(value)[:200]))


def _integer(row: Row, data: dict[str, Any], name: str) -> int | None:
    """A whole number; old dumps have times and scores as strings, some as floats."""
    value = data.get(name)
    if value is None or (value.__class__ is int and -_LARGEST < value < _LARGEST):
        return value
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            number = value if isinstance(value, int) else int(float(value))
            if -_LARGEST < number < _LARGEST:
                return number
        except (ValueError, OverflowError):
            pass
    _problem(row, name, value)
    return None


def _base36(value: Any) -> str | None:
    """The bare id that a whole number stands for, also as digits; None for anything else."""
    if isinstance(value, str) and _WHOLE.fullmatch(value.strip()):
        value = int(value.strip().partition(".")[0])
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    if not 0 < value < _LARGEST_ID or value != int(value):
        return None
    number, key = int(value), ""
    while number:
        number, digit = divmod(number, 36)
        key = _DIGITS[digit] + key
    return key


def _flag(row: Row, data: dict[str, Any], name: str) -> bool | None:
    """Yes or no, also as 1 and 0 or as words. Absent does not mean no."""
    value = data.get(name)
    answer = flag(value)
    if answer is None and value is not None:
        _problem(row, name, value)
    return answer


def _ratio(row: Row, data: dict[str, Any], name: str) -> float | None:
    """A share, 0 to 1."""
    value = data.get(name)
    if value is None:
        return None
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            if 0 <= float(value) <= 1:
                return float(value)
        except (ValueError, OverflowError):
            pass
    _problem(row, name, value)
    return None


def _text(row: Row, data: dict[str, Any], name: str, *, required: bool = False) -> str | None:
    """A text; NUL becomes U+FFFD, as a raw log replaces it."""
    value = data.get(name)
    if isinstance(value, str):
        return value if "\0" not in value else value.replace("\0", "�")
    if required or value is not None:
        _problem(row, _COLUMNS.get(name, name), value)
    return None
