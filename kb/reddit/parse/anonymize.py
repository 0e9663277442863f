"""Names of people leave an answer before it is written: only keyed hashes stay.

The key is made once in `state/reddit.key` (mode 0600) and never released, so that the hashes of a
release can't be tried out against lists of names. A fingerprint beside it detects another key, with
which the same person would be two people in old and new rows. Reddit takes a name in any letter
case for the same person, and so does the hash.
"""

import hashlib
import hmac
import re
import secrets
import shlex
from collections.abc import Collection
from functools import lru_cache
from pathlib import Path
from typing import Any

from kb.core.errors import DamagedData
from kb.reddit.parse.answer_tree import PURGED
from kb.store.atomic import write_bytes
from kb.store.damage import open_file
from kb.store.layout import Layout
from kb.store.rawlog import rawlog

# Besides everything that starts with "author": who wrote, moderated, reported, and what moderators
# note of them.
_NAMES = frozenset(
    {
        "link_author",
        "approved_by",
        "banned_by",
        "removed_by",
        "mod_reason_by",
        "mod_note",
        "display_name_prefixed",
    }
)
# Of people who reported or gave something.
_LISTS = frozenset(
    {
        "user_reports",
        "mod_reports",
        "awarders",
        "all_awardings",
        "user_reports_dismissed",
        "mod_reports_dismissed",
    }
)
_NAME, _LIST, _SUBREDDIT, _ADDRESS = "name", "list", "subreddit", "address"  # see `_about`
_WHO = _NAMES | {"author"}
_NESTED = frozenset({dict, list})
_KEPT = frozenset({"", "[deleted]", "[removed]"})
# A person's profile is a subreddit whose name is theirs: u_NAME, shown as u/NAME; its own title is
# theirs too.
_SUBREDDITS = frozenset({"subreddit", "subreddit_name_prefixed", "display_name"})
_PROFILE = re.compile(r"(?i)u[_/](?=.)")
# Addresses on Reddit, of which those of a profile begin with the name: /user/NAME/comments/…,
# /r/u_NAME/….
_ADDRESSES = frozenset({"url", "url_overridden_by_dest", "permalink", "link_permalink", "link_url"})
_PERSON = re.compile(r"(?i)((?:https?://(?:[\w-]+\.)*reddit\.com)?/(?:user/|u/|r/u_))([^/?#]+)")


def load_key(root: Path) -> bytes:
    """The data root's key; made when there are no names hashed with one yet.

    Raises DamagedData when it is lost, cut off, or another one than the data were hashed with.
    """
    path = Layout(root).key("reddit")
    if read_key(root) is None:
        write_bytes(path, secrets.token_hex(32).encode(), mode=0o600)
    path.chmod(0o600)
    key = _stored(path)
    mark = Layout(root).key_mark("reddit", key_digest(key))
    if not mark.exists():  # a new key, or one that was given anew
        write_bytes(mark, b"")
    return key


def read_key(root: Path) -> bytes | None:
    """The data root's key, None when no name was hashed with one yet. Writes nothing; raises as
    `load_key`.
    """
    path, marks = Layout(root).key("reddit"), Layout(root).key_marks("reddit")
    if not path.exists():
        if marks or rawlog.any_answer(root, "reddit"):
            raise _not_the_key(path, "is lost")
        return None
    key = _stored(path)
    if len(key) != 64:
        raise _not_the_key(path, "is damaged")
    if marks and Layout(root).key_mark("reddit", key_digest(key)) not in marks:
        raise _not_the_key(path, "is another key than this data root's")
    return key


def _stored(path: Path) -> bytes:
    with open_file(path) as file:
        return file.read().strip()


def key_digest(key: bytes) -> str:
    """What identifies a key without revealing it."""
    return hashlib.sha256(key).hexdigest()[:32]


def _not_the_key(path: Path, what: str) -> DamagedData:
    marks = Layout(path.parents[1]).raw("reddit")
    anew = f"rm -f {shlex.quote(str(marks))}/key-*.sha256"
    anew += f" && openssl rand -hex 32 > {shlex.quote(str(path))}"
    return DamagedData(
        f"{path} {what}: the authors here are hashed with it, and with another key the same"
        " author gets another hash",
        hint=f"restore the key from a copy, or use another --data folder; `{anew}` makes a new"
        " key, so that old and new rows of an author do not match",
    )


def keyed(key: bytes, text: str) -> str:
    """32 hexadecimal digits that only this key makes of a text."""
    return hmac.digest(key, text.encode("utf-8", "replace"), "sha256").hex()[:32]


class Scrubber:
    """Replaces names in raw answers by keyed hashes, the same for the same name; those of `people`,
    who asked to be left out, by PURGED.
    """

    def __init__(self, key: bytes, people: Collection[str] = ()) -> None:
        self._key, self.people = key, people
        self.hash = lru_cache(maxsize=1 << 16)(self._hash)

    def _hash(self, name: str) -> str:
        """32 hexadecimal digits for a name; `[deleted]` stays as it is."""
        if name in _KEPT:
            return name
        digest = keyed(self._key, name.lower())
        return PURGED if digest in self.people else digest

    def scrub(self, value: Any) -> Any:
        """The answer with every author field hashed, in place where it can be; safe to repeat only
        on fresh answers.
        """
        if isinstance(value, list):
            for inner in value:
                if isinstance(inner, (dict, list)):
                    self.scrub(inner)
            return value
        if not isinstance(value, dict):
            return value
        # Records of a month have the same fields, of which few name anybody.
        for name, about in _naming(tuple(value)):
            inner = value[name]
            if not inner and (inner is None or name not in _WHO):
                continue
            if isinstance(inner, str):
                value[name] = self._text(about, inner)
            elif inner and isinstance(inner, (dict, list)):
                if about in (_NAME, _LIST):
                    value[name] = []
            elif name in _WHO and not isinstance(inner, bool):
                value[name] = self.hash(str(inner))  # somebody whose name is a number
        for inner in [inner for inner in value.values() if inner and inner.__class__ in _NESTED]:
            self.scrub(inner)
        if _is_profile(value.get("subreddit")) and isinstance(value.get("domain"), str):
            value["domain"] = self.hash(value["domain"])  # self.u_NAME
        if _is_profile(value.get("display_name")):
            value.update(
                {
                    name: self.hash(value[name])
                    for name in ("title", "public_description")
                    if isinstance(value.get(name), str)
                }
            )
        return value

    def _text(self, about: str, text: str) -> str:
        if about == _NAME:
            return self.hash(text)
        if about == _LIST:
            return ""
        if about == _SUBREDDIT and (match := _PROFILE.match(text)):
            return match[0] + self.hash(text[match.end() :])
        if about == _ADDRESS and (match := _PERSON.match(text)):
            return match[1] + self.hash(match[2]) + text[match.end() :]
        return text


@lru_cache(1 << 8)
def _naming(names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Those of a record's fields that may name people, and how."""
    return tuple((name, about) for name in names if (about := _about(name)))


def _about(name: str) -> str:
    """How a field may name people; "" where it does not."""
    if name.startswith("author") or name in _NAMES:
        return _NAME
    if name in _LISTS:
        return _LIST
    if name in _SUBREDDITS:
        return _SUBREDDIT
    return _ADDRESS if name in _ADDRESSES else ""


def _is_profile(name: Any) -> bool:
    return isinstance(name, str) and name.startswith("u_")
