"""Keywords as English nouns: articles, agreement and number, as far as a name shows them."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

# The head of "boat with chest" is "boat".
_HEAD = re.compile(r"\s+(?:with|of|and|in|on|for|from|to|&)\s+")
# An article goes by the sound: "a unicorn", "an hour".
_CONSONANT = re.compile(r"uni|use|usu|ute|eu|one|ou[ij]")
_VOWEL = re.compile(r"[aeiouéèêâáàîôöäü]|hour|honest|heir")
_WITHOUT_PLURAL = re.compile(r"(?:ing|tion|ness|ism|logy|ity)$")
# Forms by whether the noun is a plural.
_AGREEING = {
    "are": ("is", "are"),
    "were": ("was", "were"),
    "have": ("has", "have"),
    "s": ("s", ""),
    "they": ("it", "they"),
    "them": ("it", "them"),
}


@dataclass(frozen=True)
class Noun:
    """A keyword in a sentence. `title` is as the profile writes it; `number`: "one" (countable),
    "many" (a plural) or "mass" ("gravel", "baking").
    """

    title: str
    number: str = "one"

    @classmethod
    def of(cls, title: str, mass: Collection[str], singular: Collection[str]) -> Noun:
        """The noun of a name, by its head. `mass`: words without a plural; `singular`: words that
        only look like one.
        """
        word = (_HEAD.split(title.lower())[0].split() or [""])[-1]
        if word in mass or _WITHOUT_PLURAL.search(word):
            return cls(title, "mass")
        plural = word.endswith("s") and not word.endswith(("ss", "us")) and word not in singular
        return cls(title, "many" if plural else "one")

    @property
    def name(self) -> str:
        """The bare words: "iron sword". An article of its own is left out ("The Nether")."""
        return self.title.lower().removeprefix("the ")

    def form(self, form: str = "") -> str:
        """`title`, `name`, `a` ("an iron sword", "gravel"), `more` ("another iron sword"), a key of
        `_AGREEING`, or the noun phrase ("the iron sword", "gravel").
        """
        if form in _AGREEING:
            return _AGREEING[form][self.number == "many"]
        if form in ("title", "name"):
            return str(getattr(self, form))
        if form == "more":
            return f"{'another' if self.number == 'one' else 'more'} {self.name}"
        if form == "a" and self.number == "one":
            vowel = _VOWEL.match(self.name) and not _CONSONANT.match(self.name)
            return f"{'an' if vowel else 'a'} {self.name}"
        return self.name if form == "a" or self.number == "mass" else f"the {self.name}"
