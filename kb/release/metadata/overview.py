"""README.md above the folders of a release: what each is, how they join, how one table is read.

Everything in it is read from the described folders themselves, so that a release of some of them
leaves the others as they were.
"""

import re
from collections.abc import Sequence
from typing import Any

import orjson

from kb.artifacts.release_folder import ReleaseFolder
from kb.artifacts.table_catalog import view_name
from kb.core.config.profile import Profile
from kb.core.sources import PUBLISHED, SOURCES
from kb.release.metadata.templates import render, sentences_on
from kb.schema import table
from kb.store.tables import parquet

CROISSANT = "croissant.json"


def overview(profile: Profile, folders: Sequence[ReleaseFolder]) -> str:
    """The text for these folders, each of which has its croissant.json; "" for none."""
    described = [folder for folder in folders if (folder.path / CROISSANT).is_file()]
    if not described:
        return ""
    main = described[0].source, PUBLISHED[described[0].source].main
    return render(
        "overview.md",
        title=profile.title,
        folders=list(map(_about, described)),
        ids=_ids(described),
        joins=_joins(described),
        main="/".join(main),
        view=view_name(table("/".join(main))),
    )


def _about(folder: ReleaseFolder) -> dict[str, Any]:
    document = orjson.loads((folder.path / CROISSANT).read_bytes())
    shards = [shard for part in folder.parts for shard in part.shards]
    deposit = orjson.loads((folder.path / "zenodo.json").read_bytes())["metadata"]
    return {
        "name": folder.source,
        "title": deposit["title"],
        "rows": sum(parquet.footer(shard).num_rows for shard in shards),
        "size": sum(path.stat().st_size for path in folder.data),
        "licence": deposit["license"],
        "uses": document["rai:dataUseCases"],
    }


def _ids(folders: Sequence[ReleaseFolder]) -> list[tuple[str, list[str]]]:
    """The keys of the sources' tables and the released tables that have them."""
    names = [
        table(f"{source}/{short}").key[0] for source in SOURCES for short in SOURCES[source].tables
    ]
    declared = [part.table for folder in folders for part in folder.parts]
    having = {
        name: [
            view_name(released) for released in declared if name in released.names(released=True)
        ]
        for name in (*names, "pair_id")
    }
    return [(name, tables) for name, tables in having.items() if len(tables) > 1]


def _joins(folders: Sequence[ReleaseFolder]) -> list[str]:
    """Of each card's queries the first that joins several folders and needs only these."""
    owners = {view_name(part.table): folder.source for folder in folders for part in folder.parts}
    chosen = []
    for folder in folders:
        for query in sentences_on(folder.source).get("joins", ()):
            named = re.findall(r"(?:FROM|JOIN) (\w+)", query)
            if set(named) <= owners.keys() and len({owners[name] for name in named}) > 1:
                chosen.append(query)
                break
    return list(dict.fromkeys(chosen))
