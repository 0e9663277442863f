"""Writes the files of `kb profile new`, after checking what they are made from."""

import re
import shlex
import tempfile
from pathlib import Path

from kb.core.config.profile import is_shipped, load_profile
from kb.core.config.profile.check import check_file
from kb.core.config.profile.check_finding import ERROR
from kb.core.config.profile.new import KEYWORDS, profile_text
from kb.core.config.profile.plausibility import subreddit_meant
from kb.core.errors import ProfileError, SettingError
from kb.core.installation import PROFILE_FILE
from kb.core.installation import folder as shared
from kb.store import leftovers
from kb.store.atomic import write_text


def write_new(
    name: str,
    out: Path | None,
    *,
    source: str | None = None,
    wiki: str | None = None,
    subreddit: str | None = None,
) -> tuple[Path, list[str]]:
    """Write the files, and return their folder and names. Nothing is overwritten.

    Raises SettingError for a wrong name or URL and for an existing file, ProfileError for a
    `source` that can't be read.
    """
    _check_name(name)
    base = load_profile(source) if source is not None else None
    text = profile_text(name, wiki=wiki, subreddit=subreddit, source=base)
    _check_given(text, wiki=wiki, subreddit=subreddit)
    files = {PROFILE_FILE: text}
    if base is None:
        files["keywords.tsv"] = KEYWORDS
    elif base.pairs is not None:
        files |= {
            listed: _read_list(base.resolve_file(listed)) for listed in base.pairs.keyword_files
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
        return not path.is_symlink() and path.read_bytes() == text.encode()
    except OSError:
        return False


def as_argument(name: str, folder: Path) -> str:
    """The new profile as an argument of other commands."""
    if is_shipped(name) and folder.resolve() == (shared("profiles") / name).resolve():
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


def _check_given(text: str, *, wiki: str | None, subreddit: str | None) -> None:
    """Raise SettingError now for values that would be refused later."""
    given = {"wiki.url": ("--wiki", wiki), "reddit.subreddit": ("--subreddit", subreddit)}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / PROFILE_FILE
        path.write_text(text, encoding="utf-8")
        wrong = {one.key: one for one in check_file(path).findings if one.level == ERROR}
    for key, (option, value) in given.items():
        if value is not None and key in wrong:
            guess = subreddit_meant(value) if key == "reddit.subreddit" else ""
            raise SettingError(f"{option} is {value!r}", hint=guess or wrong[key].fix)


def _home() -> Path:
    """Where new profiles go: the profiles of the current checkout, else the current folder."""
    profiles, here = shared("profiles"), Path.cwd()
    checkout = profiles.parent.parent
    if (checkout / "pyproject.toml").is_file() and here.is_relative_to(checkout):
        return profiles
    return Path()


def _read_list(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the keyword list {path} can't be read: {error}") from None
