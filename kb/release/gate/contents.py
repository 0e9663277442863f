"""What a release must not hold: secrets in any file (the values of the settings, and anything that
has the shape of a key), and personal data in what people wrote.

Rows with e-mail addresses and phone numbers are counted. Game talk is full of figures, so a phone
number is one of these forms only, and has 8 to 15 digits:

    +33 6 12 34 56 78     international, in groups
    (555) 010-9999        with an area code, by brackets, hyphens or dots
    0171 1234567          with a leading 0 and one or two groups
    call 555 123 4567     any other groups within a few words of call, phone, WhatsApp …

Coordinates, counts, seeds, versions and dates have none of them, or too few different digits.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from ahocorasick_rs import BytesAhoCorasick, MatchKind

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.config.profile.release import Release
from kb.core.errors import DamagedData
from kb.release.gate import GateProblem
from kb.store.damage import open_file
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

KEY_SHAPES = {
    "a Google API key": r"AIza[0-9A-Za-z_\-]{35}",
    "a Google access token": r"ya29\.[0-9A-Za-z_\-]{20,}",
    "a GitHub token": r"gh[pousr]_[0-9A-Za-z]{36}",
    "a Hugging Face token": r"hf_[0-9A-Za-z]{34}",
    "an AWS access key": r"AKIA[0-9A-Z]{16}",
    "a Slack token": r"xox[abpr]-[0-9A-Za-z\-]{10,}",
    "a private key": r"-----BEGIN [A-Z ]*PRIVATE KEY-----",
    "a bearer token": r"[Bb]earer [0-9A-Za-z_\-\.=]{20,}",
    "a JSON web token": r"eyJ[0-9A-Za-z_\-]{10,}\.eyJ[0-9A-Za-z_\-]{10,}\.",
    "a secret in an address": (
        r"(?:access_token|client_secret|api_key|apikey|[?&]key)=[0-9A-Za-z_\-]{16,}"
    ),
}
# A literal part of each shape. A file is searched for all of these at once first, which is a
# hundred times faster than one regular expression after the other.
_ANCHORS = (
    *(b"AIza", b"ya29.", b"ghp_", b"gho_", b"ghu_", b"ghs_", b"ghr_", b"hf_", b"AKIA"),
    *(b"xoxa-", b"xoxb-", b"xoxp-", b"xoxr-", b"PRIVATE KEY-----", b"earer ", b".eyJ"),
    *(b"token=", b"secret=", b"key="),
)
SHORTEST = 6  # a shorter setting would match everywhere
_CHUNK = 8 << 20
_OVERLAP = 4096  # bytes of a piece that the next one begins with: more than any shape needs
# DuckDB's expressions (RE2) know letters of every script as \pL.
_EMAIL = r"[\pL\pN._%+\-]@(?:[\pL\pN\-]+\.)+[A-Za-z]{2}"
_AMERICAN = (
    r"\([0-9]{3}\) ?[0-9]{3}[ .\-][0-9]{4}|[0-9]{3}-[0-9]{3}-[0-9]{4}|[0-9]{3}\.[0-9]{3}\.[0-9]{4}"
)
_INTERNATIONAL = r"\+[1-9][0-9]{0,2}(?:[ .\-]?\(?[0-9]{1,4}\)?){2,6}"
_NATIONAL = r"0[1-9][0-9]{1,3}[ /\-][0-9]{3,4}[ \-]?[0-9]{3,4}"
_WORDS = "(?i:call|phone|tel|telephone|telefon|whats ?app|mobile|handy|dial|ruf|sms)"
_GROUPS = r"[0-9]{2,4}(?:[ .\-/][0-9]{2,5}){1,4}"
PHONE = (
    rf"(?:^|[^0-9A-Za-z])"
    rf"(?:{_AMERICAN}|{_INTERNATIONAL}|{_NATIONAL}|{_WORDS}\b[^0-9+\n]{{0,20}}{_GROUPS})"
    rf"(?:$|[^0-9A-Za-z])"
)
_SURE = re.compile(rf"(?:^|[^0-9A-Za-z])(?:{_AMERICAN})(?:$|[^0-9A-Za-z])")
_FORM = re.compile(
    rf"(?:^|[^0-9A-Za-z])(?:({_INTERNATIONAL}|{_NATIONAL})"
    rf"|{_WORDS}\b[^0-9+\n]{{0,20}}({_GROUPS}))(?=$|[^0-9A-Za-z])"
)
_DATE = re.compile(
    r"[0-9]{1,2}[./\-][0-9]{1,2}[./\-][0-9]{4}|[0-9]{4}[./\-][0-9]{1,2}[./\-][0-9]{1,2}"
    r"|\+?[0-9]+\.[0-9]+"
)


def check_secrets(folder: ReleaseFolder, values: Sequence[str]) -> list[GateProblem]:
    """Files and columns that hold a secret; the value itself is never shown."""
    wanted = SecretPatterns(values)
    problems = []
    for path in folder.files():
        where = f"{folder.source}/{path.name}"
        search = _in_parquet if path.suffix == ".parquet" else _in_file
        with contextlib.suppress(DamagedData):  # kb.release.gate.tables reports it
            for place, what in search(path, wanted):
                problems.append(GateProblem("secret", where, f"{place} contains {what}"))
    return problems


class SecretPatterns:
    """The patterns to search for: literal values of settings, and shapes."""

    def __init__(self, values: Sequence[str]) -> None:
        literals = "|".join(re.escape(value) for value in values if len(value) >= SHORTEST)
        self.shapes = {"the value of a setting": literals} if literals else {}
        self.shapes |= KEY_SHAPES
        texts = [value.encode() for value in values if len(value) >= SHORTEST]
        self.overlap = max((_OVERLAP, *map(len, texts)))
        self._anchors = BytesAhoCorasick([*_ANCHORS, *texts], matchkind=MatchKind.LeftmostFirst)

    def anything(self, data: bytes) -> bool:
        """Whether bytes contain a value, or the literal part of a shape."""
        return bool(self._anchors.find_matches_as_indexes(data))

    def within(self, data: bytes) -> list[str]:
        """The values and shapes that bytes contain.

        Only what surrounds literal parts is looked at: screenshots have one every few megabytes by
        chance.
        """
        near: list[tuple[int, int]] = []
        for _, start, end in self._anchors.find_matches_as_indexes(data):
            first, last = max(0, start - self.overlap), end + self.overlap
            if near and first <= near[-1][1]:
                first = near.pop()[0]
            near.append((first, last))
        pieces = [data[first:last] for first, last in near]
        return [
            what
            for what, shape in self.shapes.items()
            if any(re.search(shape.encode(), piece) for piece in pieces)
        ]


def _in_file(path: Path, wanted: SecretPatterns) -> Iterator[tuple[str, str]]:
    """The values and shapes in any file, read in pieces."""
    hits: dict[str, None] = {}
    tail = b""
    with open_file(path) as file:
        while chunk := file.read(_CHUNK):
            # Most pieces contain nothing and need not be joined with the one before.
            if wanted.anything(chunk) or wanted.anything(tail + chunk[: wanted.overlap]):
                hits |= dict.fromkeys(wanted.within(tail + chunk))
            tail = (tail + chunk[-wanted.overlap :])[-wanted.overlap :]
    yield from (("it", what) for what in hits)


def _in_parquet(path: Path, wanted: SecretPatterns) -> Iterator[tuple[str, str]]:
    file = parquet.open_file(path)
    yield from (("its metadata", what) for what in wanted.within(_about(file)))
    # Of texts, and of lists and records that have some.
    names = [field.name for field in file.schema_arrow if "string" in str(field.type)]
    hits: dict[str, str] = {}
    with reading([path]):
        for batch in file.iter_batches(10_000, columns=names):
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                if name not in hits and (hit := _in_column(column, wanted)):
                    hits[name] = hit
    yield from ((f"column {name}", hits[name]) for name in names if name in hits)


def _in_column(column: pa.Array[Any], wanted: SecretPatterns) -> str | None:
    """What the texts of a column contain, also those in its lists and records."""
    if isinstance(column, (pa.ListArray, pa.StructArray)):
        inner = column.flatten()
        parts = inner if isinstance(inner, list) else [inner]
        return next((hit for part in parts if (hit := _in_column(part, wanted))), None)
    if not isinstance(column, (pa.StringArray, pa.LargeStringArray)):
        return None
    text = column.buffers()[2]
    if not text or not wanted.anything(text.to_pybytes()):
        return None
    # A shape does not continue in the next text.
    texts = "\n".join(map(str, column.drop_null().to_pylist()))
    return next(iter(wanted.within(texts.encode())), None)


def _about(file: pq.ParquetFile) -> bytes:
    """The metadata of a Parquet file: of itself, its table and its columns."""
    schema = file.schema_arrow
    lines = [name.encode() for name in (*schema.names, str(file.metadata.created_by))]
    for metadata in (
        file.metadata.metadata,
        schema.metadata,
        *(field.metadata for field in schema),
    ):
        for key, value in (metadata or {}).items():
            if key != b"ARROW:schema":  # the schema once more
                lines.append(key + b"=" + value)
    return b"\n".join(lines)


def holds_phone(text: str) -> bool:
    """Whether a text that has the shape of `PHONE` holds a number that people can be called by."""
    if _SURE.search(text):
        return True
    return any(_is_number(match[1] or match[2]) for match in _FORM.finditer(text))


def _is_number(text: str) -> bool:
    groups = re.findall("[0-9]+", text)
    digits = "".join(groups)
    if not 8 <= len(digits) <= 15 or len(set(digits)) < 3 or _DATE.fullmatch(text):
        return False
    # Round figures are counts and coordinates: 100 200 3000, +12 500 000.
    return not digits.endswith("000") and not all(group.endswith("0") for group in groups)


def check_personal(folder: ReleaseFolder, section: Release) -> list[GateProblem]:
    """Columns with more e-mail addresses or phone numbers than the profile tolerates."""
    problems = []
    for (table, name), (rows, emails, phones) in personal_counts(folder).items():
        for what, hits, tolerated, key in (
            ("an e-mail address", emails, section.emails_per_thousand, "emails_per_thousand"),
            ("a phone number", phones, section.phones_per_thousand, "phones_per_thousand"),
        ):
            if hits * 1000 > tolerated * rows:
                text = (
                    f"{hits:,} of {rows:,} rows have {what} in {name},"
                    f" [release] {key} tolerates {tolerated:g} per 1,000"
                )
                problems.append(GateProblem("personal data", f"{folder.source}/{table}", text))
    return problems


def personal_counts(folder: ReleaseFolder) -> dict[tuple[str, str], tuple[int, int, int]]:
    """(table, column) → rows, rows with an e-mail address, rows with a phone number; only of
    columns that people wrote.
    """
    totals = {
        (part.table.short, column.name): (0, 0, 0)
        for part in folder.parts
        for column in part.table.columns
        if column.released and column.content and column.type == "string"
    }
    for part in folder.parts:
        keys = [key for key in totals if key[0] == part.table.short]
        for shard in part.shards if keys else ():
            for place, *counts in _counts(shard, [name for _, name in keys]):
                rows, emails, phones = map(sum, zip(totals[keys[place]], counts, strict=True))
                totals[keys[place]] = (rows, emails, phones)
    return totals


def _counts(shard: Path, names: Sequence[str]) -> Iterator[tuple[int, int, int, int]]:
    """Of each column of a file its place in `names`, rows, and rows with either.

    DuckDB compiles a pattern wherever it stands: each stands once for all columns.
    """
    columns = ", ".join(f'"{name}"' for name in names)
    with database.asking() as con:
        counted = con.execute(
            "SELECT place, count(*),"
            f" count(*) FILTER (contains(text, '@') AND regexp_matches(text, '{_EMAIL}')),"
            f" list(text) FILTER (regexp_matches(text, '{PHONE}'))"
            f" FROM (SELECT unnest(range({len(names)})) AS place, unnest([{columns}]) AS text"
            f" FROM {scan([shard])}) GROUP BY place"
        ).fetchall()
    for place, rows, emails, numbers in counted:
        yield place, rows, emails, sum(map(holds_phone, numbers or ()))
