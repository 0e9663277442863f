"""Notes as passages."""

from collections.abc import Iterator
from pathlib import Path

from kb.core.config.profile import Profile
from kb.search.passage import Passage, day, plain, rows


def passages(profile: Profile, root: Path) -> Iterator[Passage]:
    """One passage for each note."""
    url = profile.section("feed").url
    for note in rows(root, "feed/notes", ["note_id", "text", "fetched_at"]):
        key, date = note["note_id"], day(note["fetched_at"])
        yield Passage("post", key, key, key, plain(note["text"]), f"{url}/notes/{key}", date)
