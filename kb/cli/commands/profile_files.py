"""The files of a profile: made by `kb profile new`, checked by `kb profile check` and others.

write_new(name, out)   a commented profile and keyword list for a new domain
examine(path)          every finding, for `kb profile check`
refuse(profile)        ends a crawl, a filter or pairs before anything is sent if there is an error
"""

from __future__ import annotations

import re
import shlex
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from kb.cli.framework.messages import advice
from kb.core.config.addresses import is_loopback
from kb.core.config.pipeline import own
from kb.core.config.profile import load_profile, shipped_names
from kb.core.config.profile.check import Checked, check_file
from kb.core.config.profile.new import KEYWORDS, profile_text
from kb.core.config.profile.release import Release
from kb.core.config.section import (
    ERROR,
    NOTE,
    REFUSED,
    UNREACHABLE,
    WARNING,
    WRONG,
    Finding,
    OnlineAnswer,
    QuestionCost,
    is_placeholder,
    read_text,
    worst_first,
)
from kb.core.errors import (
    CredentialRefused,
    FatalError,
    Interrupted,
    KbError,
    MissingCredential,
    MissingExtra,
    ProfileError,
    Retryable,
    SettingError,
    Stopped,
)
from kb.core.installation import PROFILE_FILE
from kb.core.installation import folder as shared
from kb.core.regular_file import read_regular
from kb.registry import SOURCES as CLASSES
from kb.store import leftovers
from kb.store.atomic import write_text
from kb.store.layout import Layout

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.context import Run


def examine(path: Path, *, publishing: bool = True) -> Checked:
    """Findings about the profile's file and its keyword lists, worst first. Without `publishing`
    errors that keep commands from running are enough.
    """
    from kb.pairs.keyword_list import check_lists

    checked = check_file(path, publishing=publishing)
    profile = checked.profile
    listed = check_lists(
        path.parent,
        checked.lists,
        profile.pairs if profile else None,
        topic_known=profile is None or profile.topic_is_known,
        advice=publishing,
    )
    return checked._replace(findings=worst_first([*checked.findings, *listed]))


def refuse(profile: Profile) -> None:
    """Raise ProfileError for errors in the profile or its lists.

    Warnings pass, and so does what only a published release needs.
    """
    errors = [
        finding
        for finding in examine(profile.path, publishing=False).findings
        if finding.level == ERROR
    ]
    if not errors:
        return
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    name = profile.path.parent.name if profile.is_shipped else str(profile.path)
    raise ProfileError(
        f"profile {profile.path.parent}/{errors[0].sentence()}{more}",
        hint=f"fix it; `kb profile check {name}` lists every problem",
    )


def contact_findings(run: Run) -> list[Finding]:
    """A KB_CONTACT that nobody reads, if public services would be sent it."""
    settings = run.settings
    roots = (settings.kb_wiki_url, settings.kb_reddit_endpoint, settings.kb_youtube_web)
    if any(root and is_loopback(root) for root in roots):
        return []  # the sandbox sets a contact of its own
    if not settings.kb_contact or not is_placeholder(settings.kb_contact):
        return []
    what = f"KB_CONTACT is the placeholder {settings.kb_contact}"
    fix = "set an address that you read: wikis and Reddit see it in the User-Agent"
    return [Finding(ERROR, ".env", 0, "KB_CONTACT", what, fix)]


_UNUSED = 10  # keywords without a match that are named
_EXAMPLES = 3
PAGES = 20  # captured pages that the selectors are tried on
_SELECTORS = "wiki selectors"
_ROOT = "wiki.markup.root"


def keyword_hits(run: Run) -> tuple[list[dict[str, Any]], list[Finding]]:
    """Matches of each keyword in clean transcripts, most first, and findings about them."""
    if run.profile.pairs is None:
        return [], []
    from kb.pairs.keyword_hits import keyword_lines

    try:
        lines = list(keyword_lines(run, _EXAMPLES, rare=True))
    except (FatalError, MissingExtra) as error:
        return [], [Finding(NOTE, "keywords", 0, "", f"not tried: {error}", advice(error.hint))]
    rows = [line._asdict() for line in lines]
    unused = [line.keyword for line in lines if not line.matches]
    if not unused:
        return rows, []
    names = ", ".join(unused[:_UNUSED]) + (" …" if len(unused) > _UNUSED else "")
    what = f"{len(unused):,} of {len(lines):,} match nothing in {run.root}: {names}"
    return rows, [Finding(NOTE, "keywords", 0, "", what, "add forms that people say instead")]


def captured_pages(root: Path) -> list[str]:
    """The HTML of some captured pages, spread evenly over all; unreadable ones are left out."""
    import zstandard

    paths = sorted(Layout(root).captures.glob("*/*/page.html.zst"))
    pages = []
    for path in paths[:: max(1, -(-len(paths) // PAGES))]:
        try:
            data = zstandard.ZstdDecompressor().decompressobj().decompress(read_regular(path))
        except (OSError, zstandard.ZstdError):
            continue
        pages.append(data.decode("utf-8", "replace"))
    return pages


def selector_findings(profile: Profile, pages: list[str]) -> list[Finding]:
    """Invalid selectors, and selectors set by the profile itself that match nothing."""
    from kb.wiki.crawl.online import count_matches
    from kb.wiki.section import WikiSection

    if (wiki := profile.section_if_any(WikiSection)) is None:
        return []
    markup = wiki.markup
    usual = type(markup)()
    own = {
        f"wiki.markup.{name}"
        for name in markup.model_fields_set
        if getattr(markup, name) != getattr(usual, name)
    }
    try:
        counts = count_matches(markup, pages)
    except (MissingExtra, Retryable) as error:
        hint = error.hint if isinstance(error, MissingExtra) else ""
        return [Finding(NOTE, _SELECTORS, 0, "", f"not tried: {error}", hint)]
    fix = "write a CSS selector, such as .infobox"
    findings = [
        Finding(ERROR, _SELECTORS, 0, key, f"'{key}' is not a CSS selector", fix)
        for key, matches in counts.items()
        if matches is None
    ]
    empty = [key for key, matches in counts.items() if matches == 0 and key in {_ROOT, *own}]
    if _ROOT in empty:
        empty.remove(_ROOT)
        what = f"'{_ROOT}' matches nothing in {len(pages)} pages, so whole pages are read"
        fix = "name the element that holds a page's text, such as .mw-parser-output"
        findings.append(Finding(WARNING, _SELECTORS, 0, _ROOT, what, fix))
    if empty:
        what = f"no match in {len(pages)} pages: {', '.join(empty)}"
        fix = "compare them with the classes in the wiki's pages"
        findings.append(Finding(WARNING, _SELECTORS, 0, empty[0], what, fix))
    return findings


def ask(run: Run) -> Iterator[tuple[Finding, QuestionCost, int]]:
    """For each source of the profile the answer, its cost, and the exit code that follows.

    Raises Interrupted only: another error is an answer as well.
    """
    for source, source_class in CLASSES.items():
        if getattr(run.profile, source) is None:
            continue
        cost = QuestionCost()
        answer: OnlineAnswer | None
        try:
            answer = source_class.question(run, cost)
        except (MissingCredential, SettingError) as error:
            answer = OnlineAnswer(WARNING, "", f"not asked: {error}", error.hint)
        except Interrupted:
            raise
        except (Retryable, Stopped) as error:
            hint = error.hint or "run the same command later"
            code = error.exit_code if isinstance(error, Stopped) else UNREACHABLE
            answer = OnlineAnswer(WARNING, "", f"no answer: {error}", hint, code)
        except KbError as error:
            code = REFUSED if isinstance(error, CredentialRefused) else WRONG
            answer = OnlineAnswer(ERROR, "", str(error), error.hint, code)
        if answer is not None:
            level, key, what, fix, code = answer
            what = f"{what} ({cost})"
            yield Finding(level, f"online: {source}", 0, key, what, fix), cost, code


def write_new(
    name: str,
    out: Path | None,
    *,
    source: str | None = None,
    wiki: str | None = None,
    subreddit: str | None = None,
    owner: Mapping[str, str | None] = MappingProxyType({}),
) -> tuple[Path, list[str]]:
    """Write the files, and return their folder and names. Nothing is overwritten.

    `owner` may have licence, creator and contact of a release.

    Raises SettingError for a wrong name or URL and for an existing file, ProfileError for a
    `source` that can't be read.
    """
    _check_name(name)
    given = {"wiki.url": ("--wiki", wiki), "reddit.subreddit": ("--subreddit", subreddit)}
    values = {key: value for key, (_, value) in given.items() if value is not None}
    base = load_profile(source) if source is not None else None
    signed = _signed(**owner)
    asked = {"release.contact": "contact"}
    asked |= dict.fromkeys(
        (f"release.licenses.{licensed}" for licensed in Release().unlicensed()), "licence"
    )
    given |= {key: (f"--{option}", owner.get(option)) for key, option in asked.items()}
    text = profile_text(name, values=values | signed, source=base)
    _check_given(text, given)
    files = {PROFILE_FILE: text}
    if base is None:
        files["keywords.tsv"] = KEYWORDS
    elif base.pairs is not None:
        files |= {name: _read(base.resolve_file(name)) for name in base.pairs.keyword_files}
    if base is not None:
        files |= {
            str(path.relative_to(base.path.parent)): _read(path) for path in own(base).values()
        }
    folder = out if out is not None else _home() / name
    existing = [file for file in files if (folder / file).exists() or (folder / file).is_symlink()]
    # A killed run leaves some of the files, with the same content.
    for file in existing:
        if len(existing) == len(files) or not _has_content(folder / file, files[file]):
            raise SettingError(
                f"{folder / file} already exists, and is not overwritten",
                hint="choose another NAME, or another folder with --out",
            )
    for file, content in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        leftovers.remove_temporary(folder / file)
        write_text(folder / file, content)
    return folder, list(files)


def _has_content(path: Path, text: str) -> bool:
    try:
        return not path.is_symlink() and read_regular(path) == text.encode()
    except OSError:
        return False


def as_argument(name: str, folder: Path) -> str:
    """The new profile as an argument of other commands."""
    if name in shipped_names() and folder.resolve() == (shared("profiles") / name).resolve():
        return name
    return shlex.quote(str(folder / PROFILE_FILE))


def _check_name(name: str) -> None:
    if re.fullmatch(r"[a-z0-9][a-z0-9_-]*", name):
        return
    plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    raise SettingError(
        f"invalid profile name {name!r}: use only lower-case letters, digits, - and _",
        hint=f"write {plain}" if plain else "for example rock-gardens",
    )


def _signed(
    *, licence: str | None = None, creator: str | None = None, contact: str | None = None
) -> dict[str, Any]:
    """Keys of [release]; one licence is for all folders but the wiki's, whose pages name one."""
    known = {
        "release.licenses": licence and dict.fromkeys(Release().unlicensed(), licence),
        "release.creators": creator and ({"name": creator},),
        "release.contact": contact,
    }
    return {key: value for key, value in known.items() if value}


def _check_given(text: str, given: Mapping[str, tuple[str, str | None]]) -> None:
    """Raise SettingError now for values that would be refused later, by their keys."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / PROFILE_FILE
        path.write_text(text, encoding="utf-8")
        wrong = {
            finding.key: finding for finding in check_file(path).findings if finding.level == ERROR
        }
    for key, (option, value) in given.items():
        if value is not None and key in wrong:
            raise SettingError(f"{option} is {value!r}", hint=wrong[key].fix)


def _home() -> Path:
    """Where new profiles go: the profiles of the current checkout, else the current folder. Raises
    UsageError in a download.
    """
    from kb.artifacts.table_catalog import refuse_download

    profiles, here = shared("profiles"), Path.cwd()
    checkout = profiles.parent.parent
    if (checkout / "pyproject.toml").is_file() and here.is_relative_to(checkout):
        return profiles
    refuse_download(here / PROFILE_FILE, "--out")
    return Path()


def _read(path: Path) -> str:
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise ProfileError(f"{path} can't be read: {why}") from None
