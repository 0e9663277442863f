"""A release that is read at an address: its tables, as kb.artifacts.table_catalog finds those of a
folder on this machine.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from kb.artifacts import manifest
from kb.artifacts.release_folder import (
    TOMBSTONES,
    sources_of,
    table_of_shard,
)
from kb.artifacts.remote_table import RemoteTable
from kb.artifacts.table_catalog import View, check_once, tombstones_view, view_name
from kb.core.errors import FatalError
from kb.schema.tables import released_tables, table
from kb.store.artifact_registry import SUMS
from kb.store.damage import missing
from kb.store.tables.remote_files import RemoteFolder, remote_folders


def read_views(address: str, options: Mapping[str, Any] | None = None) -> list[View]:
    """The tables of a release folder, or of the folders directly below an address.

    `options` are fsspec's. Raises as `remote_folders`, UsageError where two folders hold the same
    table, DamagedData for a missing shard, FatalError where there is no release.
    """
    views: dict[str, View] = {}
    for folder in remote_folders(address, options):
        sources = sources_of(folder.sizes)
        if not sources and SUMS in folder.sizes:  # every shard may be lost
            sources = sources_of(folder.sums)
        if len(sources) == 1:
            for view in _views(folder, sources.pop()):
                check_once(views, view)
    if not views:
        raise FatalError(
            f"no release in {address}",
            hint="give the address of a release folder, or of a folder of several",
        )
    return list(views.values())


def _views(folder: RemoteFolder, source: str) -> Iterator[View]:
    named = {*manifest.siblings(set(folder.sizes)), *folder.sums}
    for name in sorted(named - {*folder.sizes}):
        if table_of_shard(name):
            raise missing([f"{folder}/{name}"], "publish the release again")
    for declared in released_tables(source):
        shards = [name for name in folder.sizes if table_of_shard(name) == declared.short]
        if not shards:
            continue
        rows = RemoteTable(folder, shards)
        yield View("release", view_name(declared), [], declared.doc, folder, rows)
        if source == "links":
            yield View("links", declared.short, [], declared.doc, folder, rows)
    if TOMBSTONES in folder.sizes:
        rows = RemoteTable(folder, [TOMBSTONES])
        doc = table("shared/tombstones").doc
        yield View("release", tombstones_view(source), [], doc, folder, rows)
