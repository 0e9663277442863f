"""What a folder was made with (profile, keyword list, settings, seed, software), and what changed
since the release before.

profile.toml       the profile as used; it names its keyword list as it is called in the folder
keywords.tsv       the keyword lists as used, in one file
recipe-NAME.txt    the user's own recipes that made the data, as text
provenance.json    the rest, and what changed since the release before

For each folder and version `kb release` records the digests of its keys, in
state/releases/<source>/<version>.parquet. A release is compared with the newest lower version, so
that making the same version again changes nothing in it.
"""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import duckdb
import msgspec
import pyarrow as pa

from kb.artifacts import manifest
from kb.artifacts.freshness import lineage
from kb.artifacts.release_folder import KEYWORDS, ReleaseFolder
from kb.core.config import pipeline
from kb.core.config.profile import Profile
from kb.core.config.section import read_text
from kb.core.context import Run
from kb.core.errors import ProfileError
from kb.core.installation import PROFILE_FILE, lock_digest, software_address
from kb.core.sources import PUBLISHED, SOURCES
from kb.release.metadata.measure import Facts
from kb.schema.tables import WHEN_READ
from kb.store.artifact_registry import ARTIFACTS
from kb.store.atomic import writing
from kb.store.damage import opening
from kb.store.layout import Layout, parquet_files
from kb.store.state import tombstones
from kb.store.tables import database, parquet
from kb.store.tables.reading import scan
from kb.version import __version__

_ABOUT = b"lorebase"  # a name on disk, kept from the time before the project was renamed


class TableChange(msgspec.Struct, frozen=True):
    """One table since the release before; `changed`: None where that release noted keys alone, or
    other columns. `reasons`: rows that went by the stage that rejects them now, or "removed".
    """

    table: str
    added: int
    gone: int
    changed: int | None = None
    reasons: dict[str, int] = {}


class Changes(msgspec.Struct, frozen=True):
    """A folder since the release before; `version` empty: there is none."""

    version: str = ""
    built: str = ""
    tables: tuple[TableChange, ...] = ()
    tombstones: int = 0  # keys that were removed since


def changes(root: Path, folder: ReleaseFolder, facts: Facts, version: str) -> Changes:
    """What is new and what is gone. Raises DamagedData for a note that can't be read."""
    noted = parquet_files(Layout(root).released(folder.name))
    lower = [path for path in noted if _number(path.stem) < _number(version)]
    if not lower:
        return Changes()
    before = max(lower, key=lambda path: _number(path.stem))
    parquet.verify_files(before)
    hint = "remove it; changes since that version will be unknown"
    with opening(before, pa.ArrowException, duckdb.Error, ValueError, hint=hint):
        recorded = json.loads((parquet.footer(before).metadata or {}).get(_ABOUT, b"{}"))
        known, now = recorded.get("columns", {}), _compared(folder)
        digest = "o.content" if known else "NULL::UBIGINT"
        with database.asking() as con:
            con.register("now", _keys(folder))
            counted = con.execute(
                f"""SELECT coalesce(n."table", o."table") AS t, count(*) FILTER (o.key IS NULL),
                    count(*) FILTER (n.key IS NULL), count(*) FILTER (n.content <> {digest})
                FROM now n FULL JOIN read_parquet(?) o ON n."table" = o."table" AND n.key = o.key
                GROUP BY t ORDER BY t""",
                [str(before)],
            ).fetchall()
            tables_ = [
                TableChange(
                    short,
                    added,
                    gone,
                    changed if known.get(short) == now.get(short, []) else None,
                    _reasons(con, root, folder.source, short, before) if gone else {},
                )
                for short, added, gone, changed in counted
            ]
    return Changes(
        version=before.stem,
        built=recorded.get("built", ""),
        tables=tuple(tables_),
        tombstones=max(0, facts.tombstones - recorded.get("tombstones", 0)),
    )


def record(root: Path, folder: ReleaseFolder, facts: Facts, version: str) -> None:
    """Record the keys of this version, for the next release."""
    built = facts.built.strftime("%Y-%m-%d") if facts.built else ""
    about = {"built": built, "tombstones": facts.tombstones, "columns": _compared(folder)}
    keys = _keys(folder).replace_schema_metadata({_ABOUT: json.dumps(about).encode()})
    path = Layout(root).released(folder.name) / f"{version}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    with writing(path) as fresh:
        parquet.write_file(fresh, keys)


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part.isdigit())


def _reasons(
    con: duckdb.DuckDBPyConnection, root: Path, source: str, short: str, before: Path
) -> dict[str, int]:
    """Rows of a source's own table that went since, by what the data root says of their keys."""
    if source not in SOURCES or short not in SOURCES[source].tables:
        return {}
    prefix = SOURCES[source].tables[short]
    removed = tombstones.tombstone_rows(root, source).select(["key"])
    con.register("gone", removed)
    verdicts = "SELECT key, 'removed' AS stage, 0 AS place FROM gone"
    if files := manifest.rows(root, f"{source}/rejected"):
        verdicts += f" UNION ALL SELECT key, stage, 1 FROM {scan(files)}"
    counted = con.execute(
        f"""WITH why AS (SELECT md5_number_lower(substr(key, {len(prefix) + 1})) AS key, stage
            FROM ({verdicts}) WHERE starts_with(key, '{prefix}')
            QUALIFY row_number() OVER (PARTITION BY key ORDER BY place) = 1)
        SELECT stage, count(*) AS n FROM read_parquet($1) o JOIN why USING (key)
        WHERE o."table" = $2 AND NOT EXISTS
            (FROM now n WHERE n."table" = o."table" AND n.key = o.key)
        GROUP BY 1 ORDER BY n DESC, stage""",
        [str(before), short],
    ).fetchall()
    con.unregister("gone")
    return dict(counted)


def _compared(folder: ReleaseFolder) -> dict[str, list[str]]:
    """The columns of each table by which a row has changed or not: not when it was read."""
    return {
        part.table.short: [
            name
            for name in part.table.names(released=True)
            if name not in part.table.key and name not in WHEN_READ
        ]
        for part in folder.parts
    }


def _keys(folder: ReleaseFolder) -> pa.Table:
    """table, key and content (digests of the row's key, and of the rest) of every row, sorted."""
    parts, compared = [], _compared(folder)
    with database.asking() as con:
        for part in folder.parts:
            columns = ", ".join(f'"{name}"::VARCHAR' for name in part.table.key)
            rest = [f'coalesce("{name}"::VARCHAR, chr(30))' for name in compared[part.table.short]]
            rows: pa.Table = con.sql(
                f"""SELECT ? AS "table", md5_number_lower(concat_ws(chr(31), {columns})) AS key,
                md5_number_lower(concat_ws({", ".join(["chr(31)", "''", *rest])})) AS content
                FROM read_parquet(?) ORDER BY key""",
                params=[part.table.short, [str(shard) for shard in part.shards]],
            ).to_arrow_table()
            parts.append(rows)
    return pa.concat_tables(parts)


PROVENANCE = "provenance.json"
_COLUMNS = "keyword\tkind\trule\tforms"


def rules(profile: Profile, source: str) -> list[tuple[str, str]]:
    """(key, value) of thresholds and search words of a source, as the profile has them."""
    values = []
    for rule in PUBLISHED[source].rules:
        section, _, name = rule.partition(".")
        if (settings := getattr(profile, section, None)) is not None:
            values.append((rule, getattr(settings, name)))
    if source in SOURCES:
        threshold = profile.toxicity.threshold(source)
        shown = "not dropped" if threshold is None else threshold
        values.append((f"{source}.toxicity", shown))
    return [(rule, _shown(value)) for rule, value in values if value not in ((), [], {}, "")]


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}: {inner}" for name, inner in value.items())
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def files(run: Run, source: str, changed: Changes) -> dict[str, str]:
    """Name → text of what is written into the folder."""
    made = {PROFILE_FILE: profile_text(run.profile)}
    listed = keyword_text(run.profile)
    if listed:
        made[KEYWORDS] = listed
    recipes = _recipes(run.profile, source)
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in recipes.items()}
    document = {
        **made_with(run),
        **({"recipes": digests} if digests else {}),
        "version": run.profile.release.version,
        "settings": dict(rules(run.profile, source)),
        "changes": msgspec.to_builtins(changed) if changed.version else None,
    }
    made[PROVENANCE] = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    return made | recipes


def _recipes(profile: Profile, source: str) -> dict[str, str]:
    """The user's own recipes behind a folder, as text. Raises SettingError for one that may not
    run here.
    """
    makers = {ARTIFACTS[name].maker for name in lineage(f"release/{source}")}
    names = {maker.recipe for maker in makers if maker is not None}
    mine = {name: path for name, path in pipeline.own(profile).items() if name in names}
    return {f"recipe-{name}.txt": pipeline.own_text(profile, path) for name, path in mine.items()}


def made_with(run: Run) -> dict[str, dict[str, Any]]:
    """The software and the profile that made a folder, by name, version and digest."""
    address = software_address()
    return {
        "software": {
            "name": "lorecrawl",
            "version": __version__,
            "lock_sha256": lock_digest(),
            **({"url": address} if address else {}),
        },
        "profile": {
            "name": run.profile.name,
            "seed": run.profile.seed,
            "sha256": hashlib.sha256(_profile(run.profile).encode()).hexdigest(),
        },
    }


def profile_text(profile: Profile) -> str:
    """The profile's file, with its lists named as they lie beside it in the folder."""
    text = _profile(profile)
    lists = profile.pairs.keyword_files if profile.pairs else ()
    if lists in ((), (KEYWORDS,)):
        return text
    pattern = r"(?ms)^((?:pairs\.)?keyword_files\s*=\s*)\[.*?\]"
    return re.sub(pattern, rf'\g<1>["{KEYWORDS}"]', text, count=1)


def keyword_text(profile: Profile) -> str:
    """The keyword lists as one table: no comments, and every row with every column; "" without
    lists.
    """
    names = profile.pairs.keyword_files if profile.pairs else ()
    columns = _COLUMNS.split("\t")
    rows = []
    for name in names:
        for line in _read(profile.resolve_file(name), f"the keyword list {name}").splitlines():
            cells = [cell.strip() for cell in line.split("\t")]
            if line.strip() and not line.startswith("#") and cells != columns:
                rows.append(cells + [""] * (len(columns) - len(cells)))
    lines = ["\t".join(cells) for cells in (columns, *rows)]
    return "\n".join(lines) + "\n" if names else ""


def _read(path: Path, what: str) -> str:
    try:
        return read_text(path)
    except OSError as error:
        raise ProfileError(f"{what} can't be read: {error.strerror}") from None


def _profile(profile: Profile) -> str:
    return _read(profile.path, f"profile {profile.path}")
