"""What a profile may say by its types and can hardly mean: each rule is a few lines of its own.

look(profile, data)    (level, key, what, how to fix it) of everything; `data` is the file as read
publishing(profile)    the same of what only a published release needs
"""

import contextlib
import difflib
import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from kb.core.config.profile import Profile, load_profile, shipped_names
from kb.core.config.profile.base import FILL_IN, is_placeholder
from kb.core.config.profile.check_finding import ERROR, NOTE, WARNING
from kb.core.config.profile.everyday_words import is_everyday
from kb.core.errors import ProfileError
from kb.core.installation import folder
from kb.core.licences import KNOWN
from kb.core.sources import SOURCES, made_of

Remark = tuple[str, str, str, str]

# The assignable and the older ids of https://developers.google.com/youtube/v3/docs/videoCategories
CATEGORIES = frozenset([1, 2, 10, 15, *range(17, 45)])
_GAME = re.compile(r"UC[\w-]{22}")
_HOST = re.compile(r"[A-Za-z0-9.-]+(:\d+)?|\[[0-9a-fA-F:]+\](:\d+)?")
_CONTACT = re.compile(r"[^\s@]+@[^\s@]+\.[^\s@]|https?://[^\s/]+\.\w")
_EXAMPLES = ("example.org", "example.com", "example.net", ".example", ".invalid")

# (key, above this number nothing passes, why)
IMPOSSIBLE = (
    ("youtube.min_views", 20_000_000_000, "no video was seen as often"),
    ("youtube.min_duration_s", 43_200, "no upload is longer than 12 hours"),
    ("youtube.min_aspect_ratio", 10, "no video is as wide; wide-screen is 1.78"),
    ("wiki.min_words", 500_000, "no page may be as long"),
    ("reddit.min_score", 1_000_000, "no post has as many points"),
)


def remarks(profile: Profile, data: dict[str, Any]) -> Iterator[Remark]:
    """All that is worth telling about a profile whose types are right."""
    yield from _left_open("", data)
    yield from _own_name(profile)
    yield from _sections(profile, data)
    yield from _addresses(profile)
    yield from _youtube(profile)
    yield from _reddit(profile)
    yield from _pairs(profile)
    yield from _thresholds(profile)
    yield from _release(profile)


def publishing(profile: Profile) -> Iterator[Remark]:
    """What speaks against publishing alone, so that it ends no crawl."""
    contact = profile.release.contact
    if contact and contact != FILL_IN and is_placeholder(contact):
        message = f"'release.contact' is the placeholder \"{contact}\""
        fix = "write an address that you read, for removal requests"
        yield ERROR, "release.contact", message, fix
    for source, spdx in profile.release.licenses.items():
        if spdx not in KNOWN:
            key = f"release.licenses.{source}"
            near = difflib.get_close_matches(spdx, KNOWN, n=1, cutoff=0.5)
            fix = f'did you mean "{near[0]}"?' if near else f"known: {', '.join(sorted(KNOWN))}"
            yield ERROR, key, f"'{key}' is \"{spdx}\", no SPDX id that a release can carry", fix


def subreddit_meant(given: Any) -> str:
    """How a subreddit given as r/Name or as an address is written; "" where no name is in it."""
    match = re.search(r"(?:^|/)r/([A-Za-z0-9_]{2,21})/?$", str(given).strip())
    return f'write it without r/: "{match[1]}"' if match else ""


def _left_open(key: str, value: Any) -> Iterator[Remark]:
    """Words to fill in that are text as good as any."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _left_open(f"{key}.{name}" if key else name, inner)
    elif value == FILL_IN or (isinstance(value, list) and FILL_IN in value):
        yield ERROR, key, f"'{key}' is still to be filled in", "write what is meant there"


def _own_name(profile: Profile) -> Iterator[Remark]:
    here, name = profile.path.parent, profile.name
    if here.parent == folder("profiles").resolve() and name != here.name:
        message = f"'name' is \"{name}\", and the profile's folder is {here.name}"
        fix = f'a copied profile needs a name of its own: name = "{here.name}"'
        yield ERROR, "name", message, fix
        return
    for other in _others(profile):
        if other.name == name:
            yield from _same_name(profile, other)
        elif other.title == profile.title:
            message = f"'title' is \"{profile.title}\", that of the profile {other.name}"
            yield WARNING, "title", message, "cards and reports bear it: write your domain's own"


def _same_name(profile: Profile, other: Profile) -> Iterator[Remark]:
    subjects = list(_subjects(profile, other))
    differ = [key for key, mine, theirs in subjects if mine != theirs]
    if not differ and profile.path.parent.name == profile.name:
        return
    message = f"'name' is \"{profile.name}\", that of the shipped profile"
    if differ:
        message += f", and {_listed(differ)} {'differs' if len(differ) == 1 else 'differ'}"
    level = ERROR if len(differ) == len(subjects) else WARNING
    fix = "another domain needs a name of its own; changed numbers alone may keep it"
    yield level, "name", message, fix


def _others(profile: Profile) -> Iterator[Profile]:
    """The profiles that come with the package, this one and damaged ones left out."""
    for name in shipped_names():
        with contextlib.suppress(ProfileError):
            other = load_profile(name)
            if other.path != profile.path:
                yield other


def _subjects(one: Profile, other: Profile) -> Iterator[tuple[str, Any, Any]]:
    """What a domain is about, where both profiles say it."""
    yield "title", one.title, other.title
    if one.youtube and other.youtube:
        yield "youtube.keywords", one.youtube.keywords, other.youtube.keywords
    if one.wiki and other.wiki:
        yield "wiki.url", one.wiki.url, other.wiki.url
    if one.reddit and other.reddit:
        yield "reddit.subreddit", one.reddit.subreddit.lower(), other.reddit.subreddit.lower()


def _sections(profile: Profile, data: dict[str, Any]) -> Iterator[Remark]:
    missing = [name for name in SOURCES if name not in data]
    if len(missing) == len(SOURCES):
        *others, last = (f"[{name}]" for name in SOURCES)
        message = f"none of {', '.join(others)} and {last} is there"
        yield ERROR, "", message, "nothing can be collected: add the section of at least one source"
        return
    for name in missing:
        message = f"there is no section [{name}]"
        yield (
            NOTE,
            "",
            message,
            f"`kb {name} crawl` needs one; leave it out if you don't collect it",
        )
    (talks,) = made_of("pairs")
    if "pairs" not in data and talks in data:
        message = "there is no section [pairs]"
        yield NOTE, "", message, "`kb pairs` needs one, with keyword_files or include"
    if "pairs" in data and talks in missing:
        message = f"[pairs] has no use without [{talks}]"
        yield WARNING, "pairs", message, "pairs are made of the transcripts of videos"


def _addresses(profile: Profile) -> Iterator[Remark]:
    wiki = profile.wiki
    if wiki:
        parts = urlsplit(wiki.url)
        host = parts.hostname or ""
        if not _is_host(host):
            message = f"'wiki.url' is \"{wiki.url}\", whose host is not a full name"
            yield ERROR, "wiki.url", message, "write an address like https://minecraft.wiki"
        elif host.endswith(_EXAMPLES):
            yield WARNING, "wiki.url", f"'wiki.url' is the example {wiki.url}", "write your wiki's"
        if parts.path.endswith(".php"):
            message = f"'wiki.url' is \"{wiki.url}\", which is no root"
            yield ERROR, "wiki.url", message, f'write "{parts.scheme}://{parts.netloc}"'
        elif re.match(r"/(w|wiki)/.", parts.path):
            message = f"'wiki.url' is \"{wiki.url}\", which looks like a page"
            yield WARNING, "wiki.url", message, f'the root may be "{parts.scheme}://{parts.netloc}"'
        yield from _hosts("wiki.hosts", wiki.hosts)
    if profile.reddit:
        links = profile.reddit.links
        yield from _hosts("reddit.links.image_hosts", links.image_hosts)
        yield from _hosts("reddit.links.video_hosts", links.video_hosts)
        for name in ("image_endings", "video_endings"):
            for ending in getattr(links, name):
                if ending != ending.lower().lstrip("."):
                    key = f"reddit.links.{name}"
                    plain = ending.lower().lstrip(".")
                    yield WARNING, key, f"'{key}' holds \"{ending}\"", f'write it as "{plain}"'
    contact = profile.release.contact
    if contact and contact != FILL_IN and not _CONTACT.search(contact):
        message = f"'release.contact' is \"{contact}\", no mail or web address"
        yield (
            ERROR,
            "release.contact",
            message,
            "such as me@example.org or https://example.org/about",
        )


def _is_host(host: str) -> bool:
    """A name with a dot in it, or this machine."""
    dotted = re.fullmatch(r"[^\s.]+(\.[^\s.]+)+\.?", host)
    return bool(dotted) or host == "localhost" or ":" in host


def _hosts(key: str, hosts: tuple[str, ...]) -> Iterator[Remark]:
    for host in hosts:
        if not _HOST.fullmatch(host):
            message = f"'{key}' holds \"{host}\", which is no host"
            plain = urlsplit(host if "//" in host else f"//{host}").netloc
            yield (
                ERROR,
                key,
                message,
                f'write "{plain}"' if _HOST.fullmatch(plain) else "write a name",
            )


def _youtube(profile: Profile) -> Iterator[Remark]:
    section = profile.youtube
    if not section:
        return
    for key, words in (("keywords", section.keywords), ("topic_keywords", section.topic_keywords)):
        yield from _twice(f"youtube.{key}", words)
    for word in dict.fromkeys(section.words):
        if is_everyday(word):
            key = "youtube.topic_keywords" if section.topic_keywords else "youtube.keywords"
            message = f"'{key}' holds the everyday word \"{word}\""
            yield (
                WARNING,
                key,
                message,
                (
                    "every video of the categories with it counts as on topic;"
                    " name what only your domain says in youtube.topic_keywords"
                ),
            )
    for number in section.category_ids:
        if number not in CATEGORIES:
            message = f"'youtube.category_ids' contains {number}, which is not a YouTube category"
            yield (
                WARNING,
                "youtube.category_ids",
                message,
                "such as 20 Gaming, 26 Howto, 28 Science",
            )
    for game in section.game_ids:
        if not _GAME.fullmatch(game):
            message = f"'youtube.game_ids' holds \"{game}\", which is no browse id"
            yield WARNING, "youtube.game_ids", message, "it begins with UC and has 24 characters"
    if section.max_age_days > 30:
        message = f"'youtube.max_age_days' is {section.max_age_days}"
        fix = "the API's terms ask to read data again, or remove it, after 30 days"
        yield WARNING, "youtube.max_age_days", message, fix


def _reddit(profile: Profile) -> Iterator[Remark]:
    if profile.reddit:
        yield from _twice("reddit.search", profile.reddit.search)


def _pairs(profile: Profile) -> Iterator[Remark]:
    if not profile.pairs:
        return
    yield from _twice("pairs.include", profile.pairs.include)
    for word in profile.pairs.include:
        if is_everyday(word):
            message = f"'pairs.include' holds the everyday word \"{word}\""
            fix = "put it into a keyword list, with the rule near, never or always"
            yield WARNING, "pairs.include", message, fix


def _twice(key: str, words: tuple[str, ...]) -> Iterator[Remark]:
    seen: set[str] = set()
    for word in words:
        if word.lower() in seen:
            yield WARNING, key, f"'{key}' holds \"{word}\" twice", "take one of them out"
        seen.add(word.lower())


def _thresholds(profile: Profile) -> Iterator[Remark]:
    for key, most, why in IMPOSSIBLE:
        section, name = key.split(".")
        value = getattr(getattr(profile, section), name, 0)
        if value > most:
            yield ERROR, key, f"'{key}' is {value}: nothing passes", why
    youtube, wiki = profile.youtube, profile.wiki
    if youtube and 1.78 < youtube.min_aspect_ratio <= 10:
        message = f"'youtube.min_aspect_ratio' is {youtube.min_aspect_ratio:g}"
        yield WARNING, "youtube.min_aspect_ratio", message, "wide-screen is 1.78: hardly one passes"
    if wiki and wiki.max_page_height < wiki.viewport_height:
        message = f"'wiki.max_page_height' is {wiki.max_page_height}: nothing passes"
        fix = f"a page is at least as high as the window, {wiki.viewport_height} CSS px"
        yield ERROR, "wiki.max_page_height", message, fix
    if wiki and wiki.page_seconds <= wiki.settle_seconds:
        message = f"'wiki.page_seconds' is {wiki.page_seconds:g}"
        fix = f"more than settle_seconds ({wiki.settle_seconds:g}), or moving pages count as hung"
        yield WARNING, "wiki.page_seconds", message, fix
    for source in SOURCES:
        if profile.toxicity.threshold(source) == 0:
            key = f"toxicity.thresholds.{source}"
            fix = "every text has a score above 0; take the line out to drop none"
            yield ERROR, key, f"'{key}' is 0: nothing passes", fix


def _release(profile: Profile) -> Iterator[Remark]:
    if not profile.toxicity.on:
        message = "'toxicity' is off: no text is scored"
        yield NOTE, "toxicity", message, "the card of a release says so"
    unsigned = profile.release.unsigned()
    if "a contact" in unsigned:
        message = "'release.contact' is not set"
        yield NOTE, "", message, "where removal requests go; a published data set needs one"
    if "a creator" in unsigned:
        message = "'release.creators' is not set"
        yield NOTE, "", message, "who made the data set; a published one needs that"


def _listed(names: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
