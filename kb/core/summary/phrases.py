"""Numbers of a summary in words, as `kb.core.summary.vocabulary` names them."""

from collections.abc import Mapping
from typing import Any

from kb.core.summary.vocabulary import word


def phrase(name: str, value: Any, summary: dict[str, Any]) -> str:
    """`{"videos": 300}` as "300 videos"; "" for what a person need not read."""
    if value is None or isinstance(value, (dict, list)):
        return ""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    known = word(name, str(summary.get("command", "")))
    if known is None:
        words = name.replace("_", " ")
        return f"{value:,} {words}" if number else f"{words}: {value}"
    if not known.phrase or (not value and not known.always):
        return ""
    counted = str(summary.get("counted") or "")
    words = known.phrase.replace("{counted}", counted).replace("  ", " ")
    return count(value, words)


def count(value: Any, words: str) -> str:
    """The words with the number in place of `{n}`, in the singular for 1: "1 video crawled"."""
    if value == 1 and words.startswith("{n} ") and " and " not in words:
        parts = words.split(" ")
        plural = next((at for at, part in enumerate(parts[:3]) if part.endswith("s")), 0)
        parts[plural] = singular(parts[plural])  # "{n} quota units not spent": the noun is near
        words = " ".join(parts)
    return words.replace("{n}", f"{value:,}" if isinstance(value, (int, float)) else str(value))


# Tables whose rows are something else than their name says.
_NOUNS = {
    "playlist_videos": "entries of playlists",
    "recipes": "slots of recipes",
    "page_text": "texts of pages",
    "page_links": "links of pages",
    "recipe_edges": "ingredients of recipes",
}


def nouns(numbers: Mapping[str, int]) -> str:
    """Numbers by noun in a row: "3 channels, 1 video"."""
    return ", ".join(count(n, f"{{n}} {_NOUNS.get(name, name)}") for name, n in numbers.items())


def singular(plural: str) -> str:
    """The singular of a noun of this table."""
    if plural.endswith("ies"):
        return f"{plural[:-3]}y"
    return plural[:-2] if plural.endswith("ches") else plural.removesuffix("s")


def tally(counted: str, numbers: dict[str, int]) -> str:
    """The four answers of a table: "300 videos crawled: 207 kept, 93 rejected (9 missing) …"."""
    missing = numbers.get("missing", 0)
    missing_part = f" ({missing:,} missing)" if missing else ""
    return (
        count(numbers["crawled"], f"{{n}} {counted} crawled")
        + f": {numbers['kept']:,} kept, {numbers['rejected']:,} rejected{missing_part},"
        f" {numbers['failed']:,} failed, {numbers['pending']:,} pending"
    )
