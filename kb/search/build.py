"""Builds index/<source> for `kb index`; for a download it is in the cache.

The folder is replaced atomically. It is rebuilt when the rows or the rules differ from those in its
manifest.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from kb.artifacts import domain_binding, freshness, manifest, texts
from kb.artifacts import index as index_of
from kb.artifacts.makers import make_artifact
from kb.artifacts.table_catalog import NO_TABLES, Catalog, empty
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.search import tantivy_index
from kb.search.passage import Passage

Passages = Callable[[Profile, Path], Iterator[Passage]]


def index(run: Run) -> Summary:
    """Every source's index that is missing or out of date.

    Raises FatalError where there are no texts, WriterLocked, DamagedData, DiskFull.
    """
    if not Catalog(run.root.absolute()).views:  # before anything is written
        raise empty(run.root)
    made = {source: make_artifact(run, f"index/{source}") for source in SOURCES}
    made = {source: built for source, built in made.items() if built}
    if not made:
        raise FatalError(
            f"nothing to index: {run.root} has no texts",
            hint=NO_TABLES,
        )
    return Summary(
        command="index",
        passages=sum(built["passages"] for built in made.values()),
        indexed=sorted(source for built in made.values() for source in built["indexed"]),
        sources={source: built["passages"] for source, built in made.items()},
        path=str(index_of.folder(run.root, next(iter(made))).parent),
    )


def follow(run: Run, source: str, passages: Passages) -> Summary:
    """Make the source's index again where it has to be, or where the run says `again`: its
    passages, and whether it had to be made.

    An empty summary where the source has no texts: then no index stays either. Raises as `index`.
    """
    name, root, catalog = f"index/{source}", run.root, Catalog(run.root.absolute())
    if not catalog.is_writable and (count := _passages(run, source)) is not None:
        return Summary(passages=count, indexed=[])  # perhaps in the data root itself
    home = catalog.path if catalog.is_writable else catalog.cached
    with domain_binding.writing(run, f"index-{source}", workplace=home):
        if not texts.files(root, name):
            index_of.remove(root, source)
            return Summary()
        if (count := _passages(run, source)) is not None:
            return Summary(passages=count, indexed=[])
        inputs = texts.inputs(root, name)
        language = run.profile.language
        settings = freshness.settings(run, name)
        with (
            run.progress.task(f"index {source}", unit="passages") as task,
            manifest.replacing(home, name, inputs=inputs, settings=settings) as fresh,
        ):
            texts_of = passages(run.profile, root)
            count = tantivy_index.write_index(fresh.folder, language, texts_of, task.advance)
            fresh.figures = {"passages": count, "language": language}
    return Summary(passages=count, indexed=[source])


def _passages(run: Run, source: str) -> int | None:
    """How many passages the source's index has; None where it has to be made."""
    place, made = index_of.folder(run.root, source), index_of.known(run.root, source)
    if (
        run.again
        or made is None
        or freshness.reasons(run, f"index/{source}")
        or index_of.has_unknown_files(place, made)
        or index_of.damaged(place, made)
    ):
        return None
    return made.figures["passages"]


def ensure(run: Run, sources: Sequence[str]) -> None:
    """Make the indexes of these sources that are missing or out of date. Raises as `index`."""
    now = freshness.Now(run)
    for source in sources:
        if not texts.files(run.root, f"index/{source}", now.catalog):
            continue
        if freshness.reasons(run, f"index/{source}", now=now):
            run.progress.say(f"the index of {source} is missing or out of date; building it")
            make_artifact(run, f"index/{source}")
