"""Looks into every file of a release for secrets: the literal values of the settings,
and anything shaped like a key.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from ahocorasick_rs import BytesAhoCorasick, MatchKind

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.errors import DamagedData
from kb.release.gate.problem import GateProblem
from kb.store import parquet

KEY_SHAPES = {
    "a Google API key": r"AIza[0-9A-Za-z_\-]{35}",
    "a Google access token": r"ya29\.[0-9A-Za-z_\-]{20,}",
    "a GitHub token": r"gh[pousr]_[0-9A-Za-z]{36}",
    "an AWS access key": r"AKIA[0-9A-Z]{16}",
    "a Slack token": r"xox[abpr]-[0-9A-Za-z\-]{10,}",
    "a private key": r"-----BEGIN [A-Z ]*PRIVATE KEY-----",
    "a bearer token": r"[Bb]earer [0-9A-Za-z_\-\.=]{20,}",
    "a JSON web token": r"eyJ[0-9A-Za-z_\-]{10,}\.eyJ[0-9A-Za-z_\-]{10,}\.",
    "a secret in an address": (
        r"(?:access_token|client_secret|api_key|apikey|[?&]key)=[0-9A-Za-z_\-]{16,}"
    ),
}
# What each shape can't do without. A file is looked through for all of these at once first, which
# is a hundred times faster than one after the other; where one of them stands, for each.
_ANCHORS = {
    "a Google API key": (b"AIza",),
    "a Google access token": (b"ya29.",),
    "a GitHub token": (b"ghp_", b"gho_", b"ghu_", b"ghs_", b"ghr_"),
    "an AWS access key": (b"AKIA",),
    "a Slack token": (b"xoxa-", b"xoxb-", b"xoxp-", b"xoxr-"),
    "a private key": (b"PRIVATE KEY-----",),
    "a bearer token": (b"earer ",),
    "a JSON web token": (b".eyJ",),
    "a secret in an address": (b"token=", b"secret=", b"key="),
}
SHORTEST = 6  # a shorter setting is found everywhere and is no secret worth the name
_CHUNK = 8 << 20
_OVERLAP = 4096  # bytes of a piece that the next one begins with: more than any shape needs


def secrets(folder: ReleaseFolder, values: Sequence[str]) -> list[GateProblem]:
    """A line for each file and column that holds a secret; the value itself is never shown."""
    wanted = SecretPatterns(values)
    problems = []
    for path in folder.files():
        where = f"{folder.source}/{path.name}"
        for place, what in (
            _in_parquet(path, wanted) if path.suffix == ".parquet" else _in_file(path, wanted)
        ):
            problems.append(GateProblem("secret", where, f"{place} holds {what}"))
    return problems


class SecretPatterns:
    """What is looked for: literal values of settings, and shapes."""

    def __init__(self, values: Sequence[str]) -> None:
        self.literals = [value for value in values if len(value) >= SHORTEST]
        texts = [value.encode() for value in self.literals]
        self.overlap = max((_OVERLAP, *map(len, texts)))
        self._any = _finder(*(anchor for some in _ANCHORS.values() for anchor in some), *texts)
        self._values = [_finder(text) for text in texts]
        self._anchors = {what: [_finder(one) for one in some] for what, some in _ANCHORS.items()}

    def anything(self, data: bytes) -> bool:
        """Whether a value stands in some bytes, or what a shape can't do without."""
        return bool(self._any(data))

    def within(self, data: bytes) -> Iterator[str]:
        """The values and shapes in some bytes."""
        if not self.anything(data):
            return
        if any(find(data) for find in self._values):
            yield "the value of a setting"
        for what, anchors in self._anchors.items():
            there = any(find(data) for find in anchors)
            if there and re.search(KEY_SHAPES[what].encode(), data):
                yield what


def _finder(*texts: bytes) -> Callable[[bytes], list[Any]]:
    """Finds texts, of those that overlap the first.

    It is vectorised, which `in` is not, and a search for all matches of several neither.
    """
    return BytesAhoCorasick(texts, matchkind=MatchKind.LeftmostFirst).find_matches_as_indexes


def _in_file(path: Path, wanted: SecretPatterns) -> Iterator[tuple[str, str]]:
    """The values and shapes in any file, read in pieces."""
    hits: dict[str, None] = {}
    tail = b""
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            # Most pieces hold nothing, and are not copied to be put behind the one before.
            if wanted.anything(chunk) or wanted.anything(tail + chunk[: wanted.overlap]):
                hits |= dict.fromkeys(wanted.within(tail + chunk))
            tail = (tail + chunk[-wanted.overlap :])[-wanted.overlap :]
    yield from (("it", what) for what in hits)


def _in_parquet(path: Path, wanted: SecretPatterns) -> Iterator[tuple[str, str]]:
    try:
        file = parquet.open_file(path)
    except (pa.ArrowException, OSError, DamagedData):
        return  # the structure check reports it
    yield from (("its metadata", what) for what in wanted.within(_about(file)))
    names = [
        field.name
        for field in file.schema_arrow
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type)
    ]
    any_literal = "|".join(re.escape(value) for value in wanted.literals)
    shapes = {"the value of a setting": any_literal} if any_literal else {}
    shapes |= KEY_SHAPES
    together = "|".join(f"(?:{shape})" for shape in shapes.values())
    for name in names:
        if hit := _first(file, name, together):
            what = next((what for what, shape in shapes.items() if re.search(shape, hit)), "a key")
            yield f"column {name}", what


def _about(file: pq.ParquetFile) -> bytes:
    """What a Parquet file says beside its rows: of itself, of its table and of its columns."""
    schema = file.schema_arrow
    kept = [
        file.metadata.metadata or {},
        schema.metadata or {},
        *(field.metadata or {} for field in schema),
    ]
    lines = [
        key + b"=" + value for one in kept for key, value in one.items() if key != b"ARROW:schema"
    ]  # that is the schema once more
    return b"\n".join(
        [*lines, *(name.encode() for name in schema.names), str(file.metadata.created_by).encode()]
    )


def _first(file: object, name: str, shape: str) -> str:
    """The first text of a column that has the shape, or nothing."""
    for batch in file.iter_batches(columns=[name]):  # type: ignore[attr-defined]
        values = batch.column(0).drop_null()
        hits = values.filter(pc.match_substring_regex(values, shape))
        if len(hits):
            return str(hits[0].as_py())
    return ""
