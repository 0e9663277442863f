"""Tests of `kb.core.config.profile.new`."""

import re
from pathlib import Path
from typing import Any

from kb.core.config.profile import Profile, load_profile
from kb.core.config.profile.new import profile_text


def test_what_only_the_user_knows_stands_first() -> None:
    text = profile_text("rock-gardens")
    lines = text.splitlines()
    marked = [at for at, line in enumerate(lines) if '"FILL-IN"' in line]
    first_default = next(at for at, line in enumerate(lines) if line.startswith("#seed"))
    assert len(marked) == 3
    assert max(marked) < first_default < 40
    assert all(len(line) <= 100 for line in lines if line.startswith("# "))


def test_what_new_writes_loads_to_the_defaults(tmp_path: Path) -> None:
    made = load_profile(saved(tmp_path, filled(profile_text("rock-gardens"))))
    plain = Profile(
        name="rock-gardens",
        title="Rock Gardens",
        youtube={
            "keywords": ["Rock Gardens"],
            "playlist_keywords": ["Rock Gardens Tutorial", "Rock Gardens Guide"],
            "category_ids": [26],
        },
        wiki={"url": "https://gardens.wiki"},
        reddit={"subreddit": "rockgarden"},
        pairs={"keyword_files": ["keywords.tsv"]},
    )
    assert made.model_dump() == plain.model_dump()


def test_every_key_stands_in_it_with_its_default(tmp_path: Path) -> None:
    """Each # taken away: what is read is still the default, of every key that has one."""
    text = filled(profile_text("rock-gardens"))
    bare = re.sub(r"^#(?=[a-z\[\]\" ])(?! [^ ])", "", text, flags=re.MULTILINE)
    made = leaves(load_profile(saved(tmp_path, bare)).model_dump())
    defaults = leaves(load_profile(saved(tmp_path, text)).model_dump())
    unset = {key for key, value in defaults.items() if value is None}
    assert {key for key, value in defaults.items() if made[key] != value} == unset
    assert all(re.search(rf"^#?{re.escape(key)}( =|\.)", text, re.MULTILINE) for key in defaults)


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
