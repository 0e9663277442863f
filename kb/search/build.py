"""`kb index`: the rows of a source to index/<source>, in the cache for a download.

The folder is written anew and takes the old one's place whole, so no file of it ever held anything
else; it is made again where the rows or the rules are others than noted in it
(kb.artifacts.indexed).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kb.artifacts import belonging, indexed
from kb.artifacts.catalog import NO_TABLES, Catalog, empty
from kb.artifacts.indexed import IndexNote
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.profile import Profile
from kb.core.sources import SOURCES, SPECS
from kb.core.verdict import Summary
from kb.search import tantivy_index
from kb.search.tantivy_index import STEMMERS
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout


class BuiltIndex(NamedTuple):
    """A source's index: its passages, and whether it had to be made."""

    passages: int
    fresh: bool


def index(run: Run) -> Summary:
    """Every source's index that is missing or out of date.

    Raises FatalError where there are no texts, WriterLocked, DamagedData, DiskFull.
    """
    if not Catalog(run.root.absolute()).views:  # before anything is written
        raise empty(run.root)
    made = {source: found for source in SOURCES if (found := follow(run, source)) is not None}
    if not made:
        raise FatalError(
            f"nothing to index: {run.root} has no texts",
            hint=NO_TABLES,
        )
    return Summary(
        command="index",
        passages=sum(one.passages for one in made.values()),
        indexed=sorted(source for source, one in made.items() if one.fresh),
        sources={source: one.passages for source, one in made.items()},
        path=str(Layout(Catalog(run.root.absolute()).workplace).indexes),
    )


def follow(run: Run, source: str) -> BuiltIndex | None:
    """Make the source's index again where it has to be, or where the run says `again`.

    None where the source has no texts: then no index stays either. Raises as `index`.
    """
    with belonging.writing(run, f"index-{source}"):
        paths = indexed.files(run.root, source)
        if not paths:
            indexed.forget(run.root, source)
            return None
        rules, note = _rules(run.profile), indexed.read(run.root, source)
        now, place = indexed.prints(paths), indexed.folder(run.root, source)
        current = note is not None and note.rules == rules and note.files == now
        if note and current and not run.again and indexed.is_whole(run.root, source):
            own = indexed.own(place)
            if note.own != own:  # the same bytes, copied
                indexed.write(run.root, source, IndexNote(rules, now, own, note.passages))
            return BuiltIndex(note.passages, fresh=False)
        with (
            run.progress.task(f"index {source}", unit="passages") as task,
            replacing_folder(place) as fresh,
        ):
            spec = SPECS[source]
            passages = spec.load(spec.passages)(run.profile, run.root)
            count = tantivy_index.write(fresh, rules["stemmer"], passages, task.advance)
            indexed.write_into(fresh, IndexNote(rules, now, indexed.own(fresh), count))
    return BuiltIndex(count, fresh=True)


def ensure(run: Run, sources: Sequence[str]) -> None:
    """Make the indexes of these sources that are missing or out of date. Raises as `index`."""
    for source in sources:
        if indexed.files(run.root, source) and not indexed.is_current(run.root, source):
            run.progress.say(f"the index of {source} is missing or out of date; building it")
            follow(run, source)


def _rules(profile: Profile) -> dict[str, Any]:
    """All that decides what an index holds, besides the rows."""
    language = "en" if profile.youtube is None else profile.youtube.language
    return {
        "stemmer": STEMMERS.get(language, ""),
    }
