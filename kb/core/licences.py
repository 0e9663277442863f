"""Licences by SPDX id. Their texts are part of the package: a release needs no network for them.

licences/known.toml lists them. Texts: the licence stewards' own, as SPDX lists them
(https://spdx.org/licenses/).
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from kb.core.errors import ProfileError

_TEXTS = Path(__file__).with_name("licences")


@dataclass(frozen=True, slots=True)
class Licence:
    """A licence that data may be published under."""

    spdx: str
    title: str
    url: str
    short: str

    @property
    def zenodo(self) -> str:
        """Its name in Zenodo's licence vocabulary (SPDX ids in lower case)."""
        return self.spdx.lower()

    @property
    def hugging_face(self) -> str:
        """Its name in a dataset card's front matter."""
        return self.spdx.lower()

    @property
    def text(self) -> str:
        """The whole legal text."""
        return (_TEXTS / f"{self.spdx}.txt").read_text(encoding="utf-8")


KNOWN = {
    spdx: Licence(spdx, entry["title"], entry["url"], " ".join(entry["short"].split()))
    for spdx, entry in tomllib.loads((_TEXTS / "known.toml").read_text(encoding="utf-8")).items()
}


def licence(spdx: str) -> Licence:
    """The licence with that SPDX id. Raises ProfileError that lists the known ones."""
    try:
        return KNOWN[spdx]
    except KeyError:
        raise ProfileError(
            f"{spdx!r} is not a licence that a release can use",
            hint=f"known: {', '.join(sorted(KNOWN))}",
        ) from None
