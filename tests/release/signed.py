"""The shipped profile with a creator and a contact, without which nothing is published."""

import tempfile
from functools import cache
from pathlib import Path

from kb.core.installation import folder

LINES = """contact = "data@example.org"
creators = [{ name = "Doe, Jane" }]
"""


_PLACE = tempfile.TemporaryDirectory(prefix="kb-signed-")  # removed at the end of the process


@cache
def signed() -> Path:
    """Its file, with the keyword list beside it."""
    shipped, place = folder("profiles") / "minecraft", Path(_PLACE.name)
    (place / "keywords.tsv").write_bytes((shipped / "keywords.tsv").read_bytes())
    text = (shipped / "profile.toml").read_text(encoding="utf-8")
    (place / "profile.toml").write_text(
        text.replace("[release]\n", f"[release]\n{LINES}", 1), encoding="utf-8"
    )
    return place / "profile.toml"
