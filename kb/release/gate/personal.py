"""Counts rows with personal data that people wrote: e-mail addresses and phone numbers.

Game talk is full of figures, so a phone number is one of these forms only, and has 8 to 15 digits:

    +33 6 12 34 56 78     international, in groups
    (555) 010-9999        with an area code, by brackets, hyphens or dots
    0171 1234567          with a leading 0 and one or two groups
    call 555 123 4567     any other groups within a few words of call, phone, WhatsApp …

Coordinates, counts, seeds, versions and dates have none of them, or too few different digits.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.config.profile.release import Release
from kb.release.gate import GateProblem
from kb.store.tables import database
from kb.store.tables.reading import scan

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


def check(folder: ReleaseFolder, section: Release) -> list[GateProblem]:
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
    found = {
        (part.table.short, column.name): (0, 0, 0)
        for part in folder.parts
        for column in part.table.columns
        if column.released and column.content and column.type == "string"
    }
    for part in folder.parts:
        keys = [key for key in found if key[0] == part.table.short]
        for shard in part.shards if keys else ():
            for place, *counts in _counts(shard, [name for _, name in keys]):
                rows, emails, phones = map(sum, zip(found[keys[place]], counts, strict=True))
                found[keys[place]] = (rows, emails, phones)
    return found


def _counts(shard: Path, names: Sequence[str]) -> Iterator[tuple[int, int, int, int]]:
    """Of each column of a file its place in `names`, rows, and rows with either.

    DuckDB compiles a pattern wherever it stands, and letters of every script take it longest: each
    stands once for all columns, and that of e-mail addresses is for texts with an at sign.
    """
    columns = ", ".join(f'"{name}"' for name in names)
    with database.asking() as con:
        found = con.execute(
            "SELECT place, count(*), list(text) FILTER (contains(text, '@')),"
            f" list(text) FILTER (regexp_matches(text, '{PHONE}'))"
            f" FROM (SELECT unnest(range({len(names)})) AS place, unnest([{columns}]) AS text"
            f" FROM {scan([shard])}) GROUP BY place"
        ).fetchall()
        for place, rows, at_signs, numbers in found:
            emails = 0
            if at_signs:
                emails = con.execute(
                    f"SELECT count(*) FROM (SELECT unnest(?) AS text)"
                    f" WHERE regexp_matches(text, '{_EMAIL}')",
                    [at_signs],
                ).fetchall()[0][0]
            yield place, rows, emails, sum(map(holds_phone, numbers or ()))
