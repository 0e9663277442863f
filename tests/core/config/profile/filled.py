"""A new profile with the values that only its user knows, and its keys."""

from pathlib import Path
from typing import Any

FILLED = {  # the four lines that only the user knows
    'youtube.category_ids = ["FILL-IN"]': "youtube.category_ids = [26]",
    'wiki.url = "FILL-IN"': 'wiki.url = "https://gardens.wiki"',
    'reddit.subreddit = "FILL-IN"': 'reddit.subreddit = "rockgarden"',
    "FILL-IN\tkind": "Saxifrage\tplant",
}


def filled(text: str) -> str:
    for old, new in FILLED.items():
        text = text.replace(old, new)
    return text


def leaves(data: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in data.items():
        if isinstance(value, dict):
            found |= leaves(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def saved(place: Path, text: str) -> Path:
    path = place / "profile.toml"
    path.write_text(text, encoding="utf-8")
    return path
