"""Fields of a thing as Reddit and the archives of any year write them → values; what can't be read
is null and named.

Each reader takes the row that is being made, whose list `found` gets (column, reason, value).
"""

from __future__ import annotations

from typing import Any


def integer(row: dict[str, Any], data: dict[str, Any], name: str) -> int | None:
    """A whole number; old dumps have times and scores as strings, some as floats."""
    value = data.get(name)
    if value is None:
        return None
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            number = int(float(value)) if not isinstance(value, int) else value
            if -(1 << 62) < number < 1 << 62:
                return number
        except (ValueError, OverflowError):
            pass
    row["found"].append((name, "malformed", str(value)[:200]))
    return None


def flag(row: dict[str, Any], data: dict[str, Any], name: str) -> bool | None:
    """Yes or no, also as 1 and 0 or as words. Dumps of every year say whether a post is for adults:
    absent is not no.
    """
    value = data.get(name)
    if value is None or isinstance(value, bool):
        return value
    said = str(value).lower()
    if isinstance(value, (int, str)) and said in ("1", "0", "true", "false"):
        return said in ("1", "true")
    row["found"].append((name, "malformed", str(value)[:200]))
    return None


def ratio(row: dict[str, Any], data: dict[str, Any]) -> float | None:
    """The share of votes that are for a post, 0 to 1."""
    value = data.get("upvote_ratio")
    if value is None:
        return None
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            if 0 <= float(value) <= 1:
                return float(value)
        except (ValueError, OverflowError):
            pass
    row["found"].append(("upvote_ratio", "malformed", str(value)[:200]))
    return None


def text(
    row: dict[str, Any], data: dict[str, Any], name: str, *, needed: bool = False
) -> str | None:
    """A text; one that is `needed` and not there is named as absent. NUL becomes U+FFFD."""
    value = data.get(name)
    if isinstance(value, str):
        return value if "\0" not in value else value.replace("\0", "�")
    if value is not None:
        row["found"].append(
            ("body" if name in ("selftext", "body") else name, "malformed", str(value)[:200])
        )
    elif needed:
        row["found"].append(("body" if name in ("selftext", "body") else name, "absent", None))
    return None
