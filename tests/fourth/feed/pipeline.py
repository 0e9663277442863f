"""The feed: crawl every note, keep those with enough likes."""

from collections.abc import Iterable, Iterator

import pyarrow as pa

from kb.core.config.profile import Profile
from kb.filters.chain import Chain, Clean, RawRows
from kb.filters.predicates import AtLeast
from kb.schema.decode import ColumnReader
from kb.schema.tables import table
from kb.store.tables.partition import RawKind


def parse(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Envelopes of notes → the columns of feed/notes."""
    for rows, _ in ColumnReader(table("feed/notes"), "notes").tables(lines):
        yield rows


def clean(p: Profile) -> Clean:
    """Raw answers to notes."""
    stages = (AtLeast("likes", p.section("feed").min_likes, stage="likes"),)
    return Clean(
        source="feed",
        raw=RawRows(
            {"notes": RawKind(parse, key=("note_id",), bucket="note_id")},
            lambda newest: {"feed/notes": newest["notes"]},
        ),
        chains=(Chain("feed/notes", "note_id", stages),),
    )
