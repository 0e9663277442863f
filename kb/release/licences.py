"""Licences by SPDX id: their texts travel with the code, so that a release is whole without a network.

Texts: the licence stewards' own, as SPDX lists them (https://spdx.org/licenses/).
"""

from __future__ import annotations

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


_CC = "https://creativecommons.org"
_BY = "Share and adapt it, also commercially, if you give credit, link the licence and say what you changed."
_SA = "Share and adapt it, also commercially, if you give credit, say what you changed and pass it on under the same licence."
_NC = "Share and adapt it for non-commercial purposes, if you give credit, say what you changed and pass it on under the same licence."
KNOWN = {
    licence.spdx: licence
    for licence in (
        Licence(
            "CC-BY-4.0",
            "Creative Commons Attribution 4.0 International",
            f"{_CC}/licenses/by/4.0/",
            _BY,
        ),
        Licence(
            "CC-BY-SA-4.0",
            "Creative Commons Attribution-ShareAlike 4.0 International",
            f"{_CC}/licenses/by-sa/4.0/",
            _SA,
        ),
        Licence(
            "CC-BY-SA-3.0",
            "Creative Commons Attribution-ShareAlike 3.0 Unported",
            f"{_CC}/licenses/by-sa/3.0/",
            _SA,
        ),
        Licence(
            "CC-BY-NC-SA-4.0",
            "Creative Commons Attribution-NonCommercial-ShareAlike 4.0 International",
            f"{_CC}/licenses/by-nc-sa/4.0/",
            _NC,
        ),
        Licence(
            "CC-BY-NC-SA-3.0",
            "Creative Commons Attribution-NonCommercial-ShareAlike 3.0 Unported",
            f"{_CC}/licenses/by-nc-sa/3.0/",
            _NC,
        ),
        Licence(
            "CC0-1.0",
            "Creative Commons Zero v1.0 Universal",
            f"{_CC}/publicdomain/zero/1.0/",
            "Use it in any way, without conditions.",
        ),
    )
}


def licence(spdx: str) -> Licence:
    """The licence with that SPDX id. Raises ProfileError that lists the known ones."""
    try:
        return KNOWN[spdx]
    except KeyError:
        raise ProfileError(
            f"{spdx!r} is no licence that a release can carry",
            hint=f"known: {', '.join(sorted(KNOWN))}",
        ) from None
