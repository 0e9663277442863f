"""What is true of each source whatever its data: how it is collected, what it lacks, whom it
concerns.

The sentences are in templates/about/ and fit any domain, further ones in the profile; the figures
around them are measured (kb.release.metadata.measure).
"""

import functools
import tomllib
from collections.abc import Callable
from pathlib import Path

import msgspec

from kb.core.config.profile import Profile
from kb.core.sources import SPECS
from kb.release.metadata.template_filters import ENVIRONMENT, TEMPLATES, line


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One source in sentences: for card, datasheet, Croissant's RAI part and the deposit."""

    title: str
    summary: str
    instance: str
    collection: str
    processing: tuple[str, ...]
    absent: str
    raw: str
    people: str
    biases: tuple[str, ...]
    limits: tuple[str, ...]
    uses: tuple[str, ...]
    avoid: tuple[str, ...]
    upkeep: str
    words: tuple[str, ...]
    tasks: tuple[str, ...]
    attribution: str


def about(profile: Profile, source: str, show: Callable[[str], str] = line) -> About:
    """The sentences on a source, each in one line: those that are true of any domain, then the
    profile's own. `show` writes the profile's words, such as `md` for Markdown.
    """
    neutral, own = _neutral(source, show(profile.title)), profile.release
    return msgspec.structs.replace(
        neutral,
        biases=(*neutral.biases, *map(show, own.biases)),
        limits=(*neutral.limits, *map(show, own.limits)),
        uses=(*neutral.uses, *map(show, own.uses)),
        avoid=(*neutral.avoid, *map(show, own.avoid)),
    )


@functools.cache
def _neutral(source: str, topic: str) -> About:
    path = TEMPLATES / "about" / f"{source}.toml"
    if not path.is_file():  # a source may bring its own
        path = Path(SPECS[source].load(".spec").__file__).with_name("about.toml")
    sentences = {
        name: _render(text, topic)
        for name, text in tomllib.loads(path.read_text(encoding="utf-8")).items()
    }
    return msgspec.convert(sentences, About)


def _render(text: str | list[str], topic: str) -> str | list[str]:
    if isinstance(text, list):
        return [line(ENVIRONMENT.from_string(one).render(topic=topic)) for one in text]
    return line(ENVIRONMENT.from_string(text).render(topic=topic))
