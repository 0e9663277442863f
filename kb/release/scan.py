"""Looks into every text of a release for what must not be there: secrets and personal data.

Secrets are the literal values of the settings and anything shaped like a key. Personal data is
what people wrote into titles and texts: e-mail addresses and phone numbers, counted by row.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kb.release.folders import Folder
from kb.release.problem import Problem

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.core.profile.release import Release

KEY_SHAPES = {
    "a Google API key": r"AIza[0-9A-Za-z_\-]{35}",
    "a Google access token": r"ya29\.[0-9A-Za-z_\-]{20,}",
    "a GitHub token": r"gh[pousr]_[0-9A-Za-z]{36}",
    "an AWS access key": r"AKIA[0-9A-Z]{16}",
    "a Slack token": r"xox[abpr]-[0-9A-Za-z\-]{10,}",
    "a private key": r"-----BEGIN [A-Z ]*PRIVATE KEY-----",
    "a bearer token": r"[Bb]earer [0-9A-Za-z_\-\.=]{20,}",
    "a JSON web token": r"eyJ[0-9A-Za-z_\-]{10,}\.eyJ[0-9A-Za-z_\-]{10,}\.",
    "a secret in an address": r"(?:access_token|client_secret|api_key|apikey|[?&]key)=[0-9A-Za-z_\-]{16,}",
}
EMAIL = r"[A-Za-z0-9._%+\-]+@[A-Za-z0-9\-]+(?:\.[A-Za-z0-9\-]+)*\.[A-Za-z]{2,}"
PHONE = (
    r"(?:^|[^0-9A-Za-z])(?:\+[0-9]{1,3}[ .\-]?\(?[0-9]{2,4}\)?[ .\-]?[0-9]{3,4}[ .\-]?[0-9]{3,4}"
    r"|\([0-9]{3}\) ?[0-9]{3}[ .\-][0-9]{4}|[0-9]{3}-[0-9]{3}-[0-9]{4}|[0-9]{3}\.[0-9]{3}\.[0-9]{4})(?:$|[^0-9A-Za-z])"
)
SHORTEST = 6  # a shorter setting is found everywhere and is no secret worth the name
_CHUNK = 8 << 20


def secrets(folder: Folder, values: Sequence[str]) -> list[Problem]:
    """A line for each file and column that holds a secret; the value itself is never shown."""
    literals = [value for value in values if len(value) >= SHORTEST]
    found = []
    for path in folder.files():
        where = f"{folder.source}/{path.name}"
        for place, what in _in_parquet(path, literals) if path.suffix == ".parquet" else _in_file(path, literals):
            found.append(Problem("secret", where, f"{place} holds {what}"))
    return found


def _in_file(path: Path, literals: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Text files for values and shapes, anything else for the values."""
    wanted = [value.encode() for value in literals]
    longest = max((len(value) for value in wanted), default=0)
    tail, hit = b"", False
    with path.open("rb") as file:
        while not hit and (chunk := file.read(_CHUNK)):
            chunk = tail + chunk
            hit = any(value in chunk for value in wanted)
            tail = chunk[-longest:] if longest else b""
    if hit:
        yield "it", "the value of a setting"
    if path.suffix in (".md", ".json", ".ndjson", ".cff", ".txt", ""):
        text = path.read_text(encoding="utf-8", errors="replace")
        yield from (("it", name) for name, shape in KEY_SHAPES.items() if re.search(shape, text))


def _in_parquet(path: Path, literals: Sequence[str]) -> Iterator[tuple[str, str]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
    except (pa.ArrowInvalid, OSError):
        return  # the structure check reports it
    about = b"\n".join(key + b"=" + value for key, value in (file.schema_arrow.metadata or {}).items()).decode(errors="replace")
    if any(value in about for value in literals):
        yield "its metadata", "the value of a setting"
    names = [field.name for field in file.schema_arrow if pa.types.is_string(field.type) or pa.types.is_large_string(field.type)]
    any_literal = "|".join(re.escape(value) for value in literals)
    shapes = {"the value of a setting": any_literal} if any_literal else {}
    shapes |= KEY_SHAPES
    together = "|".join(f"(?:{shape})" for shape in shapes.values())
    for name in names:
        if hit := _first(file, name, together):
            what = next((what for what, shape in shapes.items() if re.search(shape, hit)), "a key")
            yield f"column {name}", what


def _first(file: object, name: str, shape: str) -> str:
    """The first text of a column that has the shape, or nothing."""
    import pyarrow.compute as pc

    for batch in file.iter_batches(columns=[name]):  # type: ignore[attr-defined]
        values = batch.column(0).drop_null()
        hits = values.filter(pc.match_substring_regex(values, shape))
        if len(hits):
            return str(hits[0].as_py())
    return ""


def personal(folder: Folder, section: Release) -> list[Problem]:
    """A line for each column with more e-mail addresses or phone numbers than the profile tolerates."""
    found = []
    for (table, name), (rows, emails, phones) in personal_counts(folder).items():
        for what, hits, tolerated, key in (
            ("an e-mail address", emails, section.emails_per_thousand, "emails_per_thousand"),
            ("a phone number", phones, section.phones_per_thousand, "phones_per_thousand"),
        ):
            if hits * 1000 > tolerated * rows:
                found.append(
                    Problem(
                        "personal data",
                        f"{folder.source}/{table}",
                        (f"{hits:,} of {rows:,} rows have {what} in {name}, [release] {key} tolerates {tolerated:g} per 1,000"),
                    )
                )
    return found


def personal_counts(folder: Folder) -> dict[tuple[str, str], tuple[int, int, int]]:
    """(table, column) → rows, rows with an e-mail address, rows with a phone number; what people wrote only."""
    counts: dict[tuple[str, str], tuple[int, int, int]] = {}
    for part in folder.parts:
        for column in part.table.columns:
            if column.released and column.content and column.type == "string":
                counts[part.table.short, column.name] = _count(part.shards, column.name)
    return counts


def _count(shards: Sequence[Path], name: str) -> tuple[int, int, int]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = emails = phones = 0
    for shard in shards:
        try:
            file = pq.ParquetFile(shard)
            if name not in file.schema_arrow.names:
                continue
            for batch in file.iter_batches(columns=[name]):
                values = batch.column(0).drop_null()
                rows += batch.num_rows
                emails += _matches(values, "@", EMAIL)
                phones += _matches(values, "", PHONE)
        except (pa.ArrowInvalid, OSError):
            continue
    return rows, emails, phones


def _matches(values: pa.Array, cheap: str, shape: str) -> int:
    import pyarrow.compute as pc

    if cheap:
        values = values.filter(pc.match_substring(values, cheap))
    return int(pc.sum(pc.match_substring_regex(values, shape)).as_py() or 0)
