"""The first part of a purge, which needs a source's raw answers and state under its lock."""

from kb.artifacts import purge as steps
from kb.artifacts import purge_raw
from kb.artifacts.purge import Purge, PurgeLine, PurgeRules
from kb.artifacts.purge_named import PurgeList
from kb.artifacts.purge_people import PeopleList
from kb.artifacts.purge_rows import location_of, shared_locations
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.source import Source
from kb.core.sources import SOURCES
from kb.crawl.id_list import IdRules, ListedId
from kb.crawl.session import open_session
from kb.schema.tables import table
from kb.store.layout import Layout


def remove_keys(
    run: Run, rules: PurgeRules, listed: PurgeList | None, asked: PeopleList | None = None
) -> tuple[Purge, list[PurgeLine]]:
    """Remove what is made of the source, then the keys from raw answers, kept rows and the state;
    the purge, and the rows that went.

    Damaged raw data is set aside; `steps.finish` reports it. Raises WriterLocked, DiskFull,
    Interrupted.
    """
    # Opening a session takes in what a killed crawl or import had not committed.
    connector = SOURCES[rules.source].connector(run)
    with open_session(run, connector, online=False, report_damage=False) as session:
        session.recorder.close()
        scratch = Layout(run.root).known(rules.source)
        purge = Purge(run, rules, listed, session.frontier, scratch, asked=asked)
        try:
            purge_raw.check_readable(run.root, rules.source, run.workers)
        except DamagedData:
            session.recorder.check_all_segments()
        purge.find()
        purge.begin()
        removed: list[PurgeLine] = []
        if purge.keys:
            removed += steps.derived(purge) if purge.removed else ()
            list(steps.answers(purge))
            removed += steps.kept(purge)
            steps.state(purge)
        return purge, removed


def _as_text(entry: ListedId) -> str | None:
    return str(entry.value) if entry.value else None


def rules_by_name(source: Source) -> PurgeRules:
    """The rules of a source whose items are removed by name only."""
    rows = [
        (short, prefix, table(f"{source.name}/{short}")) for short, prefix in source.tables.items()
    ]
    ids = IdRules(
        option="--ids",
        noun=f"ids of {source.counted}",
        hint="write one a line",
        columns=tuple(declared.key[0] for _, _, declared in rows),
        tables=(tuple(short for short, _, _ in rows),),
        parse=_as_text,
    )
    return PurgeRules(
        source.name,
        ids.read_some,
        rows=(
            *(location_of(one.name, one.key[0], prefix) for _, prefix, one in rows),
            *shared_locations(source.name),
        ),
        items=tuple(source.nouns),
    )
