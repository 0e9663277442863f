"""Forms under which an English name is said and written: singular, plural, joined, apart."""

from collections.abc import Collection

_SAME = {
    "sheep",
    "fish",
    "salmon",
    "cod",
    "squid",
    "deer",
    "bread",
    "ice",
    "sand",
    "gravel",
    "lava",
    "water",
    "dirt",
    "wool",
}
_ODD = {
    "wolf": "wolves",
    "leaf": "leaves",
    "shelf": "shelves",
    "bookshelf": "bookshelves",
    "calf": "calves",
    "ox": "oxen",
    "knife": "knives",
    "half": "halves",
    "mouse": "mice",
    "goose": "geese",
    "foot": "feet",
    "tooth": "teeth",
    "man": "men",
    "potato": "potatoes",
    "tomato": "tomatoes",
    "torch": "torches",
    "loaf": "loaves",
    "hoof": "hooves",
    "cactus": "cacti",
}
_SINGULAR = {plural: singular for singular, plural in _ODD.items()}


def plural(word: str) -> str:
    """ "berry" → "berries", "torch" → "torches", "wolf" → "wolves"; plurals and mass nouns stay."""
    if word in _SAME or word in _SINGULAR or not (word[-1:].isalpha() and word[:1].isascii()):
        return word
    if word in _ODD:
        return _ODD[word]
    if word.endswith(("s", "x", "z", "ch", "sh")):
        return word if word.endswith("s") and singular(word) != word else word + "es"
    if word.endswith("y") and word[-2:-1] not in "aeiou":
        return word[:-1] + "ies"
    return word + "s"


def singular(word: str) -> str:
    """ "planks" → "plank", "leaves" → "leaf"; words that only look like plurals stay ("glass",
    "cactus").
    """
    if word in _SINGULAR:
        return _SINGULAR[word]
    if (
        word in _SAME
        or not word.endswith("s")
        or word.endswith(("ss", "us", "is", "ness"))
        or len(word) < 4
    ):
        return word
    if word.endswith("ies"):
        return word[:-3] + "y"
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1]


def numbers(phrase: str) -> set[str]:
    """Singular and plural of a folded phrase: of its last word, or of the word before "of"."""
    words = phrase.split(" ")
    head = words.index("of") - 1 if "of" in words[1:] else len(words) - 1
    return {
        " ".join([*words[:head], made, *words[head + 1 :]])
        for made in (words[head], plural(words[head]), singular(words[head]))
    }


def joined(phrase: str) -> set[str]:
    """Two words written as one: "iron golem" → "irongolem"."""
    words = phrase.split(" ")
    return {"".join(words)} if len(words) == 2 and all(len(word) > 2 for word in words) else set()


def apart(word: str, known: Collection[str]) -> set[str]:
    """One word written as two that are both known: "cobblestone" → "cobble stone"."""
    if " " in word:
        return set()
    return {
        f"{word[:cut]} {word[cut:]}"
        for cut in range(3, len(word) - 2)
        if word[:cut] in known and word[cut:] in known
    }


def forms(phrase: str, known: Collection[str] = ()) -> set[str]:
    """All forms of a folded phrase, itself included."""
    variants = numbers(phrase)
    for one in tuple(variants):
        variants |= joined(one) | apart(one, known)
    return variants
