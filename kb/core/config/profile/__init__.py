"""One domain in one TOML file: keywords, addresses, thresholds, rules. No code knows a domain.

load_profile("minecraft")       by name, from the package
load_profile("mine.toml")       by path, from anywhere
"""

from __future__ import annotations

import shlex
import tomllib
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast, overload

from pydantic import Field, PrivateAttr, ValidationError, create_model

from kb.core import languages
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
from kb.core.config.section import Section, SourceSection, problems, read_text
from kb.core.errors import ProfileError, SettingError
from kb.core.installation import PROFILE_FILE, folder
from kb.core.sources import SOURCES, SourceDeclaration

DEFAULT = "minecraft"
AnySection = TypeVar("AnySection", bound=Section)


class SharedProfile(Section):
    """A whole profile but for the sections of sources. Sections that a domain has no use for may be
    left out.
    """

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]*$",
        description="short name, used in file names and titles",
        examples=["stardew-valley"],
    )
    title: str = Field(description="the domain's name for people, e.g. Minecraft")
    seed: int = Field(0, description="seed of every random choice")
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

    def section_if_any(self, source: type[AnySection]) -> AnySection | None:
        """A section by its class, or None."""
        return cast("AnySection | None", getattr(self, source.table))

    @property
    def language(self) -> str:
        """The language of its texts by its shortest code, as the first source with one names it;
        else English.
        """
        sections = (getattr(self, name) for name in SOURCES)
        named = (getattr(section, "language", "") for section in sections)
        return languages.primary_language(next(filter(None, named), "en"))

    @property
    def topic_is_known(self) -> bool:
        """Whether the topic of items can be known: no source decides it by words alone."""
        return all(getattr(getattr(self, name), "topic_is_known", True) for name in SOURCES)

    @property
    def topics(self) -> tuple[str, ...]:
        """Whole words or phrases that show the topic, of all sources that name some."""
        sections = (getattr(self, name) for name in SOURCES)
        return tuple(word for section in sections for word in getattr(section, "words", ()))

    def service_address(self, source: str) -> str:
        """The address of the service that a source is read from; "" where its section, which is
        missing, would say it.
        """
        origin, section = SOURCES[source].origin, getattr(self, source)
        if section is None:
            return "" if "{" in origin else origin
        return origin.format_map(section.model_dump())

    @property
    def is_shipped(self) -> bool:
        """Whether it is one of those that come with the package."""
        return folder("profiles").resolve() in self.path.parents

    def resolve_file(self, name: str) -> Path:
        """A file that the profile names, relative to the profile's own folder."""
        return self.path.parent / name


def _section_of(source: SourceDeclaration) -> type[SourceSection]:
    """The class in the module `section` of a source's package. Raises SettingError."""
    module = import_module(f"{source.module}.section")
    for section in vars(module).values():
        if isinstance(section, type) and getattr(section, "table", "") == source.name:
            return cast("type[SourceSection]", section)
    raise SettingError(
        f"{module.__file__} has no SourceSection with table = {source.name!r}",
        hint="a source's package declares its settings there",
    )


if TYPE_CHECKING:
    Profile = SharedProfile
else:
    Profile = create_model(
        "Profile",
        __base__=SharedProfile,
        __module__=__name__,
        **{name: (_section_of(source) | None, None) for name, source in SOURCES.items()},
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
