"""What a purge has to know about Reddit: what authors deleted, moderators removed, or is gone, and
for `--authors` what people wrote who ask to be left out.

Keys are full names. The comments of a purged post go with it (reason `post`), as their addresses
contain its title. Replies to a purged comment stay. Of a person who asks to be left out all posts
and comments go, and others' records no longer mention them by their hash.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import manifest
from kb.artifacts.purge import Purge, PurgeRules, by_presence, with_named
from kb.artifacts.purge_people import MARK, PeopleRules, Theirs, in_rows
from kb.artifacts.purge_raw import AnswerRules, Matcher, Names, over_segments
from kb.artifacts.purge_rows import RowLocation, shared_locations
from kb.crawl.id_list import IdList
from kb.reddit.crawl.ids import RULES as IDS
from kb.reddit.crawl.subreddit import INFO
from kb.reddit.parse import answer_tree
from kb.reddit.parse.anonymize import keyed, load_key, read_key
from kb.reddit.parse.answer_tree import PURGED, theirs, without_hashes
from kb.reddit.parse.assemble import count_again
from kb.reddit.parse.latest_state import latest_state
from kb.reddit.parse.remove_ids import crossposts_of, drop_hashes, drop_parents, strip
from kb.store.layout import BELOW
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import tombstones

AUTHOR_COLUMNS = tuple(
    RowLocation(str(base / short), f"reddit/{short}", key, prefix)
    for base in (BELOW.clean("reddit"), BELOW.reconstructed, BELOW.restored("reddit"))
    for short, key, prefix in (("posts", "post_id", "t3_"), ("comments", "comment_id", "t1_"))
)
_NAME = r"[A-Za-z0-9_-]{1,32}"
# NAME, u/NAME, /user/NAME/comments/…; a person's profile is a subreddit of its own, r/u_NAME.
_PATH = re.compile(rf"/?(?:(?:u|user)/|r/u_)({_NAME})(?:[/?#].*)?", re.IGNORECASE)
_HOST = re.compile(r"(?:https?://)?(?:[\w-]+\.)*reddit\.com(?=/)", re.IGNORECASE)


def name_of(entry: str) -> str | None:
    """The name in a line of a list, None for what names nobody ("[deleted]", a post's address)."""
    host = _HOST.match(entry)
    path = _PATH.fullmatch(entry[host.end() :] if host else entry)
    if path is not None:
        return path[1]
    return entry if host is None and re.fullmatch(_NAME, entry) else None


def marks(purge: Purge, name: str) -> tuple[str, ...]:
    """The hash of a name as answers have it, and as earlier versions made it, which kept the
    letter case. Raises DamagedData.
    """
    # A plan makes no key: without one there is nobody's name.
    key = (read_key(purge.root) or b"") if purge.dry else load_key(purge.root)
    return tuple(dict.fromkeys((keyed(key, name.lower()), keyed(key, name))))


def find_people(purge: Purge, people: frozenset[str]) -> Iterator[Theirs]:
    """What these people posted and commented, by answers and tables. Raises DamagedData."""
    paths = rawlog.all_segments(purge.root, "reddit")
    work = ((str(path), people) for path in paths)
    for by_person in over_segments(purge.run, paths, _in_segment, work):
        for person, names in by_person.items():
            yield from (Theirs(person, name) for name in names)
    for location in AUTHOR_COLUMNS:
        yield from in_rows(purge.root, location, "author_hash", people)


def _in_segment(segment: str, people: frozenset[str]) -> Mapping[str, set[str]]:
    """Full names in the answers of a segment, by person. Runs in a worker."""
    matches, by_person = Matcher(people), defaultdict[str, set[str]](set)
    for _, line in rawlog.Frames(Path(segment), checked=True):
        if matches(line):
            envelope = rawlog.decode(line)
            for person in matches.texts(line):
                if (own := without_hashes(envelope, [person])) is not envelope:
                    by_person[person] |= theirs(own.response) - {PURGED}
    return dict(by_person)


PEOPLE = PeopleRules(
    option="--authors",
    noun="authors",
    hint="write one a line: NAME, u/NAME or the address of the profile",
    parse=name_of,
    marks=marks,
    find=find_people,
)


REBUILT = (BELOW.reconstructed, BELOW.restored("reddit"))
BASES = (BELOW.clean("reddit"), *REBUILT)


def read_list(path: Path, say: Callable[[str], None] | None = None) -> IdList:
    """The full names that a list names; a bare id is a post. Raises SettingError."""
    listed = IDS.some_ids_in(path, say)
    names = (key if key[:3] in ("t1_", "t3_") else f"t3_{key}" for key in listed.keys)
    return listed._replace(keys=list(dict.fromkeys(names)))


def find_lost(purge: Purge) -> dict[str, str]:
    """What the user named, and keys with reason `deleted`, `removed`, `missing`, or `post` for
    comments of posts that are removed.
    """
    named, keys = by_presence(purge), dict[str, str]()
    with latest_state(purge.run, purge.scratch) as things:
        for rows in things:
            lost = rows.filter(pc.or_(pc.invert(rows["there"]), pc.is_valid(rows["gone"])))
            reasons = pc.fill_null(lost["gone"], "missing").to_pylist()
            for name, reason in zip(lost["fullname"].to_pylist(), reasons, strict=True):
                keys.setdefault(str(name), reason)
        # A post that was purged before may have got comments since.
        names = {*named, *purge.keys, *keys, *tombstones.keys(purge.root, "reddit")}
        posts = pa.array(sorted(name[3:] for name in names if name.startswith("t3_")), pa.string())
        for rows in things:
            is_comment = pc.starts_with(rows["fullname"], "t1_")
            below = pc.and_(is_comment, pc.is_in(rows["post_id"], value_set=posts))
            for name in rows["fullname"].filter(below).to_pylist():
                keys.setdefault(str(name), "post")
    return with_named(named, keys)


def texts(keys: Collection[str]) -> set[str]:
    """Bare ids: the record of a thing has its id without the kind."""
    return set(map(answer_tree.bare, keys))


def strip_names(kind: str, envelope: Envelope, names: Names) -> Envelope | None:
    """Remove posts and comments from the trees of an answer, and people from the rest."""
    return strip(kind, without_hashes(envelope, names.get(MARK, ())), names[""])


def crossposts(envelope: Envelope, keys: Collection[str]) -> set[str]:
    """Bare ids of posts that repeat one of the keys, also if an interrupted purge stripped them."""
    return crossposts_of(envelope.response, keys)


def forget(purge: Purge) -> None:
    """Remove trees, threads and comments to ask for; a listing that would go on behind a removed
    post starts again. What kept rows say of removed ones: parents of crossposts, people, counts.
    """
    with manifest.editing(purge.root, *map(str, REBUILT)):
        for base in REBUILT:
            posts = purge.root / base / "posts"
            drop_parents(posts, purge.repeats, purge.keys)
            drop_hashes(posts, purge.names.get(MARK, ()))
            count_again(purge.root / base)
    frontier, names = purge.frontier, purge.keys
    for kind, prefix in (("tree", "t3_"), ("more", "t1_"), (INFO.kind, "")):
        frontier.remove(kind, [key.removeprefix(prefix) for key in names if key.startswith(prefix)])
    frontier.remove(
        "thread",
        [
            key
            for key, *_ in frontier.items("thread")
            if f"t3_{key.partition('/')[0]}" in names or f"t1_{key.partition('/')[2]}" in names
        ],
    )
    for key, _, _, payload in frontier.items("listing"):
        if payload is not None and payload.after in names:
            start = msgspec.structs.replace(payload, after=None, pages=0)
            frontier.payload("listing", key, start)


RULES = PurgeRules(
    "reddit",
    read_list,
    rows=(
        *(
            location
            for base in BASES
            for location in (
                RowLocation(str(base / "posts"), "reddit/posts", "post_id", "t3_"),
                RowLocation(str(base / "comments"), "reddit/comments", "comment_id", "t1_"),
                RowLocation(str(base / "comments"), "reddit/comments", "post_id", "t3_"),
            )
        ),
        *(RowLocation(str(base), "reddit/missing", "key") for base in REBUILT),
        *shared_locations("reddit"),
    ),
    answers=AnswerRules(texts=texts, strip=strip_names, repeats=crossposts),
    find=find_lost,
    forget=forget,
    people=PEOPLE,
)
