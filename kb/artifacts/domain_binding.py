"""A data root remembers the profile of its data, whose keywords and thresholds fit no other domain,
and which services they came from; mixing two would spoil both.

state/profile.json holds the name and, for a profile of one's own, its file; state/profile/ a copy
of the profile, its keyword files and recipes as the newest command used them, for when they are
gone. Like a service's host a profile binds once something is stored: a mistyped one that nothing
came from does no harm. Numbers may change within a profile; another name is refused (OtherService,
exit 2).
"""

import contextlib
import filecmp
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from kb.artifacts.data_roots import FORMAT, is_root
from kb.artifacts.table_catalog import Catalog
from kb.core.config import pipeline
from kb.core.config.profile import Profile, load_profile, shipped_names
from kb.core.context import Run
from kb.core.errors import OtherService, ProfileError, SettingError
from kb.core.installation import PROFILE_FILE
from kb.core.sources import SOURCES
from kb.store import leftovers, lock
from kb.store.atomic import write_bytes
from kb.store.damage import read_note
from kb.store.layout import Layout
from kb.store.rawlog import rawlog


class Remembered(msgspec.Struct, frozen=True):
    """A profile by name; `file`: where one of the user's own was, `from_root`: from the root."""

    name: str
    file: str | None = None
    from_root: str | None = None
    format: int = FORMAT


def remembered(root: Path) -> Remembered | None:
    """The profile that binds the data root; None while nothing is stored. Raises DamagedData."""
    profile = _read(root)
    return profile if profile is not None and _holds_data(root) else None


def profile_of(root: Path) -> Path | None:
    """The profile that came with a download or with what was restored of one."""
    restored = Layout(root).restored() / PROFILE_FILE
    if restored.is_file():
        return restored
    return next((release.profile for release in Catalog(root).releases if release.profile), None)


def require_domain(root: Path, profile: Profile) -> None:
    """Raises OtherService when the data root holds data of another profile."""
    bound = remembered(root)
    if bound is not None and bound.name != profile.name:
        raise OtherService(
            f"{root} holds data of the profile {bound.name!r}, not {profile.name!r}",
            hint=f"use another --data folder, or --profile {bound.file or bound.name}",
        )


def load(root: Path, bound: Remembered) -> tuple[Profile, str]:
    """The remembered profile, and a line for the user when it is not the file that it was.

    Raises ProfileError when it is gone or can't be read, OtherService when its file has another
    name now.
    """
    message = ""
    if bound.file is None:
        profile = load_profile(bound.name)
    else:
        places = [Path(bound.file)]
        if bound.from_root is not None:
            places.append(Path(os.path.normpath(root / bound.from_root)))
        there = next((place for place in places if place.is_file()), None)
        if there is not None:
            profile = load_profile(there)
        elif (kept := Layout(root).kept_profile / PROFILE_FILE).is_file():
            profile = load_profile(kept)
            message = f"{bound.file} is gone; its copy in the data root is used: {kept}"
        elif bound.name in shipped_names():
            profile = load_profile(bound.name)
            message = f"{bound.file} is gone; the shipped profile {bound.name!r} is used"
        else:
            raise ProfileError(
                f"{bound.file}, the profile {bound.name!r} of {root}, is gone",
                hint="name its new location with --profile FILE; the data root remembers it",
            )
    require_domain(root, profile)
    return profile, message


def note(root: Path, profile: Profile) -> None:
    """Remember the profile of what is about to be written; the file may be another one than before.

    Where that memory was deleted the root is bound again, if the rest that it remembers agrees.
    What another command of this moment has noted binds before anything is stored. Raises
    OtherService.
    """
    require_domain(root, profile)
    recipes = _trusted(profile)
    for path, text in recipes.items():
        pipeline.remember(path, text)
    if Layout(root).kept_profile.resolve() in profile.path.parents:  # the root's own copy is used
        return
    if _read(root) != _of(root, profile):
        with lock.deciding(Layout(root).profile):
            _note(root, profile)
    _keep(root, profile, recipes)  # not what was refused


def _trusted(profile: Profile) -> dict[Path, str]:
    """The user's own recipes that may run, with their texts."""
    texts = {}
    for path in pipeline.own(profile).values():
        with contextlib.suppress(SettingError):  # which whoever runs it raises
            texts[path] = pipeline.own_text(profile, path)
    return texts


def _keep(root: Path, profile: Profile, recipes: Mapping[Path, str]) -> None:
    """Copy the profile, its keyword files and recipes into the data root, where they have changed.
    A recipe's copy may run on this machine.
    """
    if profile.path == Path():
        return
    names = profile.pairs.keyword_files if profile.pairs else ()
    for source, name in (
        (profile.path, PROFILE_FILE),
        *((profile.resolve_file(n), n) for n in names),
    ):
        place = Layout(root).kept_profile / name
        if source.is_file() and not (place.is_file() and filecmp.cmp(source, place, shallow=False)):
            write_bytes(place, source.read_bytes())
    for path, text in recipes.items():
        place = Layout(root).kept_profile / path.relative_to(profile.path.parent)
        if not place.is_file() or place.read_bytes() != text.encode():
            write_bytes(place, text.encode())
        pipeline.remember(place, text)


def _note(root: Path, profile: Profile) -> None:
    require_domain(root, profile)
    old = _read(root)
    if old is not None and old.name != profile.name and (pid := lock.another(root)):
        raise OtherService(
            f"another process (pid {pid}) is starting {root} with the profile {old.name!r},"
            f" not {profile.name!r}",
            hint="use another --data folder, or wait for it",
        )
    if old is None and _holds_data(root) and not _agrees(root, profile):
        return
    leftovers.remove_temporary(
        Layout(root).profile
    )  # a command that takes no lock of this root was killed
    write_bytes(Layout(root).profile, msgspec.json.encode(_of(root, profile)))


def _of(root: Path, profile: Profile) -> Remembered:
    file = None if profile.is_shipped or profile.path == Path() else str(profile.path)
    relative = os.path.relpath(file, root.absolute()) if file else None
    return Remembered(profile.name, file, relative)


@contextlib.contextmanager
def writing(run: Run, *locks: str, workplace: Path | None = None) -> Iterator[None]:
    """Hold these locks of the run's data root, which remembers the run's profile from then on; of a
    download, those of its workplace, or of another folder for what can't be kept in the root.

    Every command that works on stored data writes inside this block, and looks for the
    credential, model or extra that it needs before it. A root without data is left as it is.
    Raises WriterLocked, OtherService.
    """
    catalog = Catalog(run.root.absolute())
    place = workplace or catalog.workplace
    if place != catalog.path:
        place.mkdir(parents=True, exist_ok=True)
    with lock.taking(place, *locks):
        if place == catalog.path:
            note_if_stored(run.root, run.profile)
        yield


def note_if_stored(root: Path, profile: Profile) -> None:
    """The same as `note` where data is stored; else nothing is written."""
    if is_root(root) and _holds_data(root):
        note(root, profile)


def _read(root: Path) -> Remembered | None:
    fix = "delete it, then name the profile once with --profile NAME|FILE"
    return read_note(Layout(root).profile, Remembered, fix=fix)


def _holds_data(root: Path) -> bool:
    made = (at := Layout(root)).clean(), at.pairs, at.release()
    return any(rawlog.any_answer(root, source) for source in SOURCES) or any(
        folder.is_dir() for folder in made if is_root(root)
    )


def _agrees(root: Path, profile: Profile) -> bool:
    """Whether the services, as far as they were noted, can be this profile's. Another one is
    refused where no setting could have named it.
    """
    agrees = True
    for source in SOURCES:
        section = getattr(profile, source)
        if section is None or not (other := section.other_service(bound_services(root, source))):
            continue
        if not section.set_elsewhere:
            raise OtherService(
                f"{root} holds {source} data of {other},"
                f" which is not that of the profile {profile.name!r}",
                hint="use another --data folder, or the --profile it was made with",
            )
        agrees = False
    return agrees


def bind_service(root: Path, source: str, **facts: str) -> None:
    """Note a source's hosts, subreddit or wiki, or compare with what was noted.

    Addresses are compared by host and path, ports aside. What was noted binds once an answer is
    stored: a mistyped address that nothing came from does no harm. Raises OtherService (exit 2)
    before anything was sent or written.
    """
    new = {name: _host(value) for name, value in facts.items()}
    old = bound_services(root, source)
    other = [name for name, value in new.items() if old.get(name, value) != value]
    if other and not rawlog.any_answer(root, source):
        old, other = {}, []
    if other:
        raise OtherService(
            f"{root} holds {source} data of {other[0]} {old[other[0]]}, not {new[other[0]]}",
            hint="use another --data folder, or the settings it was made with",
        )
    if new.items() - old.items():
        noted_now = msgspec.json.encode({**old, **new}, order="sorted")
        write_bytes(Layout(root).identity(source), noted_now)


def bound_services(root: Path, source: str) -> dict[str, str]:
    """What was noted of a source; empty when nothing was. Raises DamagedData."""
    fix = "delete it; the next crawl records its services again"
    return read_note(Layout(root).identity(source), dict[str, str], fix=fix) or {}


def _host(value: str) -> str:
    parts = urlsplit(value)
    return f"{parts.hostname}{parts.path.rstrip('/')}" if parts.scheme else value
