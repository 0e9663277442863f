"""The first part of a purge, which needs a source's raw answers and state under its lock."""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from kb.artifacts import purge as steps
from kb.artifacts import purge_raw
from kb.artifacts.purge import Purge, PurgeLine, PurgeRules
from kb.artifacts.purge_named import PurgeList
from kb.artifacts.purge_people import PeopleList
from kb.artifacts.purge_rows import RowLocation, location_of, shared_locations
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import SourceDeclaration
from kb.crawl.connector import Connector, Opened
from kb.crawl.id_list import IdRules, ListedId
from kb.crawl.session import open_session
from kb.schema import raw
from kb.schema.tables import table
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.recorder import replay_segment
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier


def remove_keys(
    run: Run,
    connector: Connector,
    rules: PurgeRules,
    listed: PurgeList | None,
    asked: PeopleList | None = None,
) -> tuple[Purge, list[PurgeLine]]:
    """Remove what is made of the source, then the keys from raw answers, kept rows and the state;
    the purge, and the rows that went.

    Damaged raw data is set aside; `Purge.damage` says so. Raises WriterLocked, DiskFull,
    Interrupted.
    """
    # Opening a session takes in what a killed crawl or import had not committed.
    with open_session(run, connector, online=False, report_damage=False) as session:
        session.recorder.close()
        scratch = Layout(run.root).known(rules.source)
        purge = Purge(run, rules, listed, session.frontier, scratch, asked=asked)
        for step in (purge.find_keys, purge.begin, purge.scan):
            try:
                step()
            except DamagedData:  # nothing was removed yet
                session.recorder.check_all_segments()
                step()
        purge.damage = session.recorder.damage
        removed: list[PurgeLine] = []
        if purge.keys:
            removed += steps.derived(purge) if purge.removed else ()
            list(steps.answers(purge))
            removed += steps.kept(purge)
            steps.state(purge)
        return purge, removed


@contextmanager
def dry_purge(
    run: Run,
    connector: Connector,
    rules: PurgeRules,
    listed: PurgeList | None,
    asked: PeopleList | None = None,
) -> Iterator[Purge]:
    """A dry purge on a copy of the source's state that has taken in all raw answers. Nothing below
    the data root is written.
    """
    original = Layout(run.root).state(rules.source)
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(TemporaryDirectory(prefix="lorecrawl-plan-")))
        for file in (original, original.with_name(f"{original.name}-wal")):
            if file.is_file():
                shutil.copyfile(file, scratch / file.name)
        frontier = Frontier(scratch / original.name, payloads=connector.payloads)
        stack.callback(frontier.close)
        removed = tombstones.keys(run.root, rules.source)
        connector.begin(Opened(run=run, frontier=frontier, purged=removed))
        stack.callback(connector.close)
        for segment in rawlog.all_segments(run.root, rules.source):
            with suppress(DamagedData):  # which the purge sets aside
                replay_segment(segment, frontier, connector.reduce)
        purge = Purge(run, rules, listed, frontier, scratch / "work", True, asked)
        purge.find_keys()
        purge.begin()
        purge.scan()
        yield purge


def ids_of(source: SourceDeclaration) -> IdRules:
    """How ids are read for a source that has no rules of its own: as they are, of the table whose
    key column names them, else of the main one. Where the service's ids are numbers, one with the
    prefix of a table is a key of it; where they are text, it may be an id that begins so.
    """
    tables = {short: table(f"{source.name}/{short}") for short in source.tables}
    prefixes = {tables[short].key[0]: prefix for short, prefix in source.tables.items()}
    main = tables[source.main].key[0]
    (key,) = (column for column in tables[source.main].columns if column.name == main)
    schema = raw.at(f"{source.name}/{key.source.kind}", key.source.path) or {}
    are_numbers = schema.get("type") == "integer"

    def key_of(entry: ListedId) -> str | None:
        text = str(entry.value or "")
        if are_numbers and text.startswith(tuple(filter(None, prefixes.values()))):
            return text
        return f"{prefixes.get(entry.column, prefixes[main])}{text}" if text else None

    return IdRules(
        option="--ids",
        noun=f"ids of {source.counted}",
        hint="write one a line",
        columns=tuple(prefixes),
        tables=(tuple(source.tables),),
        parse=key_of,
    )


def rules_by_name(source: SourceDeclaration) -> PurgeRules:
    """The rules of a source whose items are removed by name, and where the service no longer has
    them: what a refresh asked for and did not get.
    """
    rows = [
        (short, prefix, table(f"{source.name}/{short}")) for short, prefix in source.tables.items()
    ]

    def absent(purge: Purge) -> dict[str, str]:
        items = purge.frontier.items(source.refreshed, "skipped") if source.refreshed else ()
        before = tombstones.keys(purge.root, source.name)
        lost = {key: "vanished" for key, _, why, _ in items if why == "not_found"}
        fresh = {key: why for key, why in lost.items() if key not in before}
        return steps.with_named(steps.by_presence(purge), fresh)

    return PurgeRules(
        source.name,
        ids_of(source).some_ids_in,
        rows=(
            *(location_of(table.name, table.key[0], prefix) for _, prefix, table in rows),
            *(_restored(source) if source.restored else ()),
            *shared_locations(source.name),
        ),
        items=tuple(source.nouns),
        answers=purge_raw.AnswerRules(texts=lambda keys: (source.table_of(key)[1] for key in keys)),
        find=absent,
    )


def _restored(source: SourceDeclaration) -> Iterator[RowLocation]:
    """Restored rows, by their own key and by that of the item that they belong to."""
    item = table(f"{source.name}/{source.main}").key[0], source.tables[source.main]
    for short, prefix in source.tables.items():
        name, place = f"{source.name}/{short}", BELOW.restored(source.name)
        for column, before in dict.fromkeys(((table(name).key[0], prefix), item)):
            yield RowLocation(str(place / short), name, column, before)
        yield RowLocation(str(place), "shared/missing", "key", prefix)
        yield RowLocation(str(BELOW.restored()), "shared/missing", "key", prefix, source.name)
