"""What is true of each source whatever its data: how it is collected, what it lacks, whom it
concerns.

The sentences are in templates/about/; the figures around them are measured (kb.release.measure).
"""

from __future__ import annotations

import functools
import tomllib

import msgspec

from kb.release.render import ENVIRONMENT, TEMPLATES
from kb.release.texts import line


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


@functools.cache
def about(source: str, topic: str) -> About:
    """The sentences on a source, each in one line; `topic` is written into them as it is given."""
    path = TEMPLATES / "about" / f"{source}.toml"
    sentences = {
        name: _filled(said, topic)
        for name, said in tomllib.loads(path.read_text(encoding="utf-8")).items()
    }
    return msgspec.convert(sentences, About)


def _filled(said: str | list[str], topic: str) -> str | list[str]:
    if isinstance(said, list):
        return [line(ENVIRONMENT.from_string(one).render(topic=topic)) for one in said]
    return line(ENVIRONMENT.from_string(said).render(topic=topic))
