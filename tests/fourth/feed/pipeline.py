"""The feed: crawl every note, keep those with enough likes."""

from collections.abc import Iterable, Iterator

import pyarrow as pa

from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.filters.chain import Chain, Clean, RawRows
from kb.filters.filter_run import check_kept, run_clean
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


def tables(run: Run) -> Summary:
    """raw/feed to clean/feed."""
    return check_kept(run, "feed", run_clean(run, "feed"))


def export(run: Run, format: str = "parquet") -> Summary:
    """clean/feed to release/feed."""
    return layouts.export(run, "feed", format)
