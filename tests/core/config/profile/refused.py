"""A small valid profile, and the check that a change of it is refused in a user's words."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.errors import ProfileError

GOOD = 'name = "garden"\ntitle = "Garden"\n[youtube]\nkeywords = ["roses"]\ncategory_ids = [26]\n'
_OF_PYDANTIC = ("input", "tuple", "instance", "pydantic", "string_pattern", "[type")


def write(folder: Path, text: str) -> Path:
    """A profile's file."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refuse(folder: Path, old: str, new: str, *fragments: str) -> None:
    """Assert that the profile with `new` in place of `old` is refused with all `fragments`."""
    assert old in GOOD
    with pytest.raises(ProfileError) as error:
        load_profile(write(folder, GOOD.replace(old, new, 1)))
    message = str(error.value)
    assert [one for one in fragments if one not in message] == [], message
    assert [word for word in _OF_PYDANTIC if word in message.lower()] == [], message
