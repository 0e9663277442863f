"""One domain in one TOML file: keywords, addresses, thresholds, rules. No code knows a domain.

load_profile("minecraft")       by name, from the package
load_profile("mine.toml")       by path, from anywhere
"""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from pydantic import Field, PrivateAttr, ValidationError, create_model

from kb.core.config.profile.base import Section, problems, read_text
from kb.core.config.profile.collecting import RedditSection, WikiSection, YouTubeSection
from kb.core.config.profile.products import (
    ClipFiles,
    EntityLinks,
    Pairs,
    Report,
    Scoring,
    Tasks,
    Toxicity,
)
from kb.core.config.profile.release import Release
from kb.core.errors import ProfileError
from kb.core.installation import PROFILE_FILE, folder
from kb.core.sources import SOURCES

DEFAULT = "minecraft"
AnySection = TypeVar("AnySection", bound=Section)


class ShippedProfile(Section):
    """A whole profile. Sections that a domain has no use for may be left out."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]*$",
        description="short name, used in file names and titles",
        examples=["stardew-valley"],
    )
    title: str = Field(description="the domain's name for people, e.g. Minecraft")
    seed: int = Field(0, description="seed of every random choice")
    youtube: YouTubeSection | None = None
    wiki: WikiSection | None = None
    reddit: RedditSection | None = None
    pairs: Pairs | None = None
    tasks: Tasks = Tasks()
    links: EntityLinks = EntityLinks()
    clips: ClipFiles = ClipFiles()
    score: Scoring = Scoring()
    toxicity: Toxicity = Toxicity()
    release: Release = Release()
    report: Report = Report()
    path: Path = Field(
        Path(), exclude=True, description="the file it was read from; set when loading"
    )

    _is_named: bool = PrivateAttr(False)

    @property
    def is_named(self) -> bool:
        """Whether the user named it in this run, so that its recipes may run
        (kb.core.config.pipeline).
        """
        return self._is_named

    @overload
    def section(self, source: type[AnySection]) -> AnySection: ...
    @overload
    def section(self, source: str) -> Any: ...

    def section(self, source: type[Section] | str) -> Any:
        """A section, by its class or name. Raises ProfileError when the profile has none."""
        name = source if isinstance(source, str) else source.table
        value = getattr(self, name)
        if value is None:
            raise ProfileError(
                f"profile {self.name!r} has no section [{name}]",
                hint=f"add [{name}] to {self.path}",
            )
        return value

    @property
    def is_shipped(self) -> bool:
        """Whether it is one of those that come with the package."""
        return folder("profiles").resolve() in self.path.parents

    def resolve_file(self, name: str) -> Path:
        """A file that the profile names, relative to the profile's own folder."""
        return self.path.parent / name


if TYPE_CHECKING:
    Profile = ShippedProfile
else:  # with the sections of further sources
    Profile = create_model(
        "Profile",
        __base__=ShippedProfile,
        __module__=__name__,
        **{
            name: (section | None, None)
            for name, source in SOURCES.items()
            if (section := source.section()) is not None
        },
    )


def load_profile(name: str | Path, *, named: bool = False) -> Profile:
    """The profile of that name in the package, or in that file. `named`: the user named it, not
    some data.

    Raises ProfileError naming the key, the value and what is allowed.
    """
    path = find_profile(str(name))
    check = f"`kb profile check {shlex.quote(str(name))}` lists all that is wrong, with its line"
    try:
        data = tomllib.loads(read_text(path))
    except OSError as error:
        raise ProfileError(f"profile {path} can't be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ProfileError(f"profile {path} is not valid TOML: {error}", hint=check) from None
    except RecursionError:
        raise ProfileError(f"profile {path} is nested too deeply", hint=check) from None
    if "path" in data:
        raise ProfileError(f"profile {path}: unknown key 'path'")
    try:
        # A link's own name and folder: files that it names lie beside it, not where the link leads.
        profile = Profile(**data, path=path.parent.resolve() / path.name)
        profile._is_named = named
        return profile
    except ValidationError as error:
        wrong = [f"{what}: {fix}" if fix else what for _, what, fix in problems(error, Profile)]
        raise ProfileError(f"profile {path}: {'; '.join(wrong)}", hint=check) from None


def shipped_names() -> list[str]:
    """The names of the profiles that come with the package, sorted."""
    return sorted(path.parent.name for path in folder("profiles").glob(f"*/{PROFILE_FILE}"))


def find_profile(name: str) -> Path:
    """The file of a profile by name, or the path that was given. Raises ProfileError."""
    if name.endswith(".toml") or "/" in name:
        path = Path(name)
        return path / PROFILE_FILE if path.is_dir() else path
    known = shipped_names()
    if name in known:
        return folder("profiles") / name / PROFILE_FILE
    hint = f"known: {', '.join(known)}; or give a path to a .toml file"
    if (Path(name) / PROFILE_FILE).is_file():
        hint = f"give the one in this folder by its path: {name}/{PROFILE_FILE}"
    raise ProfileError(f"there is no profile {name!r}", hint=hint)
