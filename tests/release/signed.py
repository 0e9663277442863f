"""The shipped profile with a creator and a contact that people can reach, without which nothing is
published.
"""

import re
import tempfile
from functools import cache
from pathlib import Path

from kb.core.installation import folder

SIGNED = """contact = "data@example.org"
creators = [{ name = "Doe, Jane" }]
"""
LICENCES = (
    "licenses = { youtube = 'CC-BY-4.0', reddit = 'CC-BY-4.0', pairs = 'CC-BY-4.0',"
    " wiki = 'CC-BY-SA-4.0' }\n"
)
LINES = SIGNED + LICENCES


_PLACE = tempfile.TemporaryDirectory(prefix="kb-signed-")  # removed at the end of the process


@cache
def signed() -> Path:
    """Its file, with the keyword list beside it."""
    shipped, place = folder("profiles") / "minecraft", Path(_PLACE.name)
    (place / "keywords.tsv").write_bytes((shipped / "keywords.tsv").read_bytes())
    text = (shipped / "profile.toml").read_text(encoding="utf-8")
    before, _, after = re.split(r"(\[\[release\.creators]].*\nname = .*\n)", text)
    before = re.sub(r"(?m)^contact = .*\n", SIGNED, before)
    (place / "profile.toml").write_text(before + after, encoding="utf-8")
    return place / "profile.toml"
