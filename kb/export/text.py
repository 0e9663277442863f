"""`--format text`: `export/text/<source>.jsonl`, a JSON line a document, as datatrove's JsonlReader
and Dolma read it.

    {"id", "text", "source", "added" (fetched_at), "created" (the item's own date),
     "metadata": {"title", "url", "license", …}}

The text is Markdown and begins with `# Title`; the title is a line, whatever it was. Each source
says what its documents are (`kb/<source>/text.py`): pieces of text, some of which begin something
new (a heading, a comment, a paragraph after a pause). Chunks of at most so many tokens go to
`export/text/<source>-chunks.jsonl` and are cut there; a piece that is longer than a chunk is cut
between its lines, else where a sentence ends, else between two words, else anywhere. Chunks begin
with the title too, and with the headings that they stand under, as far as these take half of a
chunk. Their ids are `<id>-<number>` from 0, and `metadata` has `document`, `chunk` and `chunks`.

Documents are in the order of the clean parts, which workers make side by side; the same clean rows
give the same bytes. For one's own use: licences are those in `metadata`.
"""

from __future__ import annotations

import functools
import re
import unicodedata
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec

from kb.artifacts.table_catalog import Catalog
from kb.artifacts.texts import exported_files
from kb.core.context import Run
from kb.core.engine import executor_of, map_in_order
from kb.core.errors import FatalError, SettingError
from kb.core.installation import require
from kb.core.regular_file import check_regular
from kb.core.scripts import words
from kb.core.sources import SourceDeclaration
from kb.core.summary import Summary
from kb.export.contacts import replaced
from kb.store.artifact_registry import ARTIFACTS, CHUNKS
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables.reading import reading

TOKENS_A_WORD = 1.3
LEAST_TOKENS = 32  # of a chunk: less is hardly more than its title
_GAP = "\n\n"
# Longer ones are addresses, code or base64, of which tokenizers make tokens of one or two signs.
_LONGEST_WORD = 20
_SIGNS_A_TOKEN = 1.5
_SENTENCE = re.compile(r"""[.!?…]["'”’)\]]*\s|[。！？｡]["'”’」』）]*|[។။]|\n""")
_SPACE = re.compile(r"\s+")
_JOINER = "\u200d"  # of an emoji's parts
_MOST_SIGNS = 40  # of a token, on average over a chunk


class TextPiece(NamedTuple):
    """A piece of a document's text. `begins`: a chunk may begin with it; `level`: of a heading."""

    text: str
    begins: bool = False
    level: int = 0


class TextDocument(NamedTuple):
    """A page, thread or video. `metadata` has at least `url` and `license`."""

    id: str
    title: str
    pieces: Sequence[TextPiece]
    added: datetime | None
    created: datetime | None
    metadata: dict[str, Any]


class TextOptions(NamedTuple):
    """What a user asked for; `tokenizer` is a tokenizer.json, else tokens are estimated."""

    chunk_tokens: int = 0
    tokenizer: str = ""
    keep_contacts: bool = False

    @property
    def counted(self) -> str:
        """What a token is, in words."""
        if self.tokenizer:
            return f"tokens of {self.tokenizer}"
        return f"words × {TOKENS_A_WORD}, as are signs of scripts without spaces"


TextFiles = Mapping[str, Sequence[str]]
"""The files of each table with rows of the same items."""


class DocumentSource(Protocol):
    """A source whose texts are exported."""

    @property
    def declared(self) -> SourceDeclaration:
        """Its declaration."""

    def text_documents(self, files: TextFiles, origin: str) -> Iterator[TextDocument]:
        """The documents of one bucket: `files` of the `textual` tables, none for one without rows,
        and the address of the service. Raises DamagedData.
        """


def export(run: Run, of: DocumentSource, out: Path | None = None, **asked: Any) -> Summary:
    """Kept or restored rows to export/text/<source>.jsonl, chunks to <source>-chunks.jsonl, as
    TextOptions say; both to `out` where it is given, as it is for a download. Without such rows the
    file is empty.

    Raises FatalError where a table that texts are made of is not there, SettingError for a file
    that is no tokenizer, MissingExtra, DamagedData, DiskFull.
    """
    options = TextOptions(**asked)
    if options.tokenizer:
        _tokenizer(options.tokenizer)
    source = of.declared.name
    catalog = Catalog(run.root.absolute())
    files = {
        name: exported_files(catalog, name)
        for name in (f"{source}/{short}" for short in of.declared.textual)
    }
    if absent := [name for name, paths in files.items() if not paths]:
        raise FatalError(
            f"nothing to export: {run.root} has no content of {' or '.join(absent)}",
            hint=f"run `{ARTIFACTS[f'clean/{source}'].command}` first",
        )
    main, every = next(iter(files)), [path for paths in files.values() for path in paths]
    size = sum(path.stat().st_size for path in every)
    path = (out or Layout(run.root).export("text")) / (
        source + (CHUNKS if options.chunk_tokens else ".jsonl")
    )
    counts: Counter[str] = Counter(documents=0)
    origin = run.profile.service_address(source)
    with (
        reading(every),
        executor_of(run, size) as executor,
        writing(path) as temporary,
        temporary.open("wb") as file,
        run.progress.task(f"{source} as text", total=len(files[main]), unit="parts") as task,
    ):
        # Shards of a release are cut by size: all are read together.
        together = {name: [*map(str, paths)] for name, paths in files.items()}
        buckets = [together] if catalog.is_download else _buckets(files, main)
        tasks = ((of, bucket, origin, options) for bucket in buckets)
        for lines, counted in map_in_order(executor, _lines, tasks, executor.window):
            file.write(lines)
            counts += counted
            task.advance()
    counts.setdefault("documents", 0)
    about_tokens = {"tokens": options.counted} if options.chunk_tokens else {}
    contacts = {} if options.keep_contacts else {"contacts": counts.pop("contacts", 0)}
    return Summary(format="text", **counts, **contacts, **about_tokens, path=str(path))


def _buckets(files: Mapping[str, Sequence[Path]], main: str) -> Iterator[TextFiles]:
    """Of each table the file with rows of the same items. Clean and restored tables are written in
    parts, alike in all tables.
    """
    at = {name: {path.name: str(path) for path in paths} for name, paths in files.items()}
    for part in at[main]:
        yield {name: [paths[part]] if part in paths else [] for name, paths in at.items()}


def _lines(
    of: DocumentSource, files: TextFiles, origin: str, options: TextOptions
) -> tuple[bytes, Counter[str]]:
    """The lines of one bucket; runs in a worker."""
    counts: Counter[str] = Counter()
    encoder, buffer, end = msgspec.json.Encoder(), bytearray(), 0
    for document in of.text_documents(files, origin):
        for record in _records(of.declared.name, document, options, counts):
            encoder.encode_into(record, buffer, end)
            buffer += b"\n"
            end = len(buffer)
    return bytes(buffer), counts


def _records(
    source: str, document: TextDocument, options: TextOptions, counts: Counter[str]
) -> Iterator[dict[str, Any]]:
    pieces, title = document.pieces, " ".join(document.title.split())
    contacts: Counter[str] = Counter()
    if not options.keep_contacts:
        pieces = [piece._replace(text=replaced(piece.text, contacts)) for piece in pieces]
        title = replaced(title, Counter())
    counts["documents"] += 1
    counts["contacts"] += contacts.total()
    record = {
        "id": document.id,
        "text": "",
        "source": source,
        "added": _time(document.added),
        "created": _time(document.created),
        "metadata": {"title": title, **document.metadata},
    }
    if not options.chunk_tokens:
        text = _GAP.join([f"# {title}", *(piece.text for piece in pieces)])
        yield {**record, "text": text}
        counts["words"] += len(text.split())
        return
    chunks = list(_chunks(f"# {title}", pieces, options))
    counts["chunks"] += len(chunks)
    for number, text in enumerate(chunks):
        counts["words"] += len(text.split())
        of = {"document": document.id, "chunk": number, "chunks": len(chunks)}
        yield {
            **record,
            "id": f"{document.id}-{number}",
            "text": text,
            "metadata": {**record["metadata"], **of},  # type: ignore[dict-item]
        }


def _time(when: datetime | None) -> str | None:
    if when is None:
        return None
    return when.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _chunks(title: str, pieces: Iterable[TextPiece], options: TextOptions) -> Iterator[str]:
    """The text in chunks of at most so many tokens, each with the title and the headings above."""
    short = _shortened(title, options)
    if short != title:
        pieces = [TextPiece(title.removeprefix("# "), begins=True), *pieces]
    headings: list[TextPiece] = []
    head = [short]
    body: list[str] = []
    size = count(short, options)
    filled = False  # with more than headings
    for unit in _units(pieces):
        above = [
            heading for heading in headings if not unit[0].level or heading.level < unit[0].level
        ]
        more = sum(count(piece.text, options) for piece in unit)
        if filled and size + more > _room(options):
            yield from _bounded(head, body, options)
            head, body, filled = _head(short, above, options), [], False
            size = _size(head, options)
        headings = above
        for piece in unit:
            repeated = _size(_head(short, headings, options), options)
            for text in _cut(piece.text, _room(options) - repeated, options):
                more = count(text, options)
                if filled and size + more > _room(options):
                    yield from _bounded(head, body, options)
                    head, body, filled = _head(short, headings, options), [], False
                    size = repeated
                body.append(text)
                size += more
                filled = filled or not piece.level
            if piece.level:
                headings = [*headings, piece]
    if body or not headings:
        yield from _bounded(head, body, options)


def _bounded(head: list[str], body: list[str], options: TextOptions) -> Iterator[str]:
    """A chunk; several where a tokenizer makes more tokens of it than of its parts."""
    text = _GAP.join([*head, *body])
    if len(body) < 2 or count(text, options) <= _room(options):
        yield text
        return
    half = len(body) // 2
    yield from _bounded(head, body[:half], options)
    yield from _bounded(head, body[half:], options)


def _room(options: TextOptions) -> int:
    """Tokens of a chunk but for those that a model puts around it."""
    if not options.tokenizer:
        return options.chunk_tokens
    around: int = _tokenizer(options.tokenizer).num_special_tokens_to_add(is_pair=False)
    return options.chunk_tokens - around


def _shortened(title: str, options: TextOptions) -> str:
    """The title, or as much of it as a quarter of a chunk holds."""
    most = options.chunk_tokens / 4
    if count(title, options) <= most:
        return title
    return next(_in_parts(title, most - count("…", options), options)) + "…"


def _head(title: str, headings: Sequence[TextPiece], options: TextOptions) -> list[str]:
    """The title and the innermost headings that half of a chunk holds."""
    head: list[str] = []
    size = count(title, options)
    for heading in reversed(headings):
        size += count(heading.text, options)
        if size > options.chunk_tokens / 2:
            break
        head.insert(0, heading.text)
    return [title, *head]


def _size(parts: Iterable[str], options: TextOptions) -> float:
    return sum(count(part, options) for part in parts)


def _units(pieces: Iterable[TextPiece]) -> Iterator[list[TextPiece]]:
    """Pieces from one that begins something to the next."""
    unit: list[TextPiece] = []
    for piece in pieces:
        if piece.begins and unit:
            yield unit
            unit = []
        unit.append(piece)
    if unit:
        yield unit


def _cut(text: str, most: float, options: TextOptions) -> Iterator[str]:
    """A text, or its lines, or parts of these, each of at most `most` tokens. A table's parts have
    its head.
    """
    if count(text, options) <= most:
        yield text
        return
    lines = text.split("\n")
    head = lines[:2] if len(lines) > 2 and lines[1].startswith("| ---") else []
    if (base := _size(head, options)) > most / 2:
        head, base = [], 0.0
    part, size = list(head), base
    for line in lines[len(head) :]:
        for piece in _in_parts(line, most - base, options):
            more = count(piece, options)
            if len(part) > len(head) and size + more > most:
                yield "\n".join(part)
                part, size = list(head), base
            part.append(piece)
            size += more
    yield "\n".join(part)


def _in_parts(line: str, most: float, options: TextOptions) -> Iterator[str]:
    """A line in parts of at most `most` tokens. Each but the last ends in its second half where a
    sentence ends, else between two words, else anywhere.
    """
    while count(line, options) > most:
        ahead = range(1, min(len(line), int(most * _MOST_SIGNS) + 2))
        longest = max(bisect_right(ahead, most, key=lambda end: count(line[:end], options)), 1)
        places = (
            [
                match.end()
                for match in ending.finditer(line, longest // 2, longest + 1)
                if len(line[: match.end()].rstrip()) <= longest
            ]
            for ending in (_SENTENCE, _SPACE)
        )
        end = next((ends[-1] for ends in places if ends), longest)
        while 1 < end < len(line) and (_is_mark(line[end]) or line[end - 1] == _JOINER):
            end -= 1
        yield line[:end].rstrip()
        line = line[end:].lstrip()
    yield line


def _is_mark(sign: str) -> bool:
    """Whether a sign belongs to the one before."""
    return sign == _JOINER or unicodedata.category(sign)[0] == "M"


def count(text: str, options: TextOptions) -> float:
    """Tokens of a text and of the gap before it."""
    if not options.tokenizer:
        return _estimated(text)
    encoded = _tokenizer(options.tokenizer).encode(_GAP + text, add_special_tokens=False)
    return len(encoded.ids)


def _estimated(text: str) -> float:
    parted = words(text)
    if len(text) <= _LONGEST_WORD:
        return len(parted) * TOKENS_A_WORD
    long = [word for word in parted if len(word) > _LONGEST_WORD]
    signs = sum(map(len, long)) / _SIGNS_A_TOKEN
    return (len(parted) - len(long)) * TOKENS_A_WORD + signs


@functools.cache
def _tokenizer(path: str) -> Any:
    require("pairs", "tokenizers")
    from tokenizers import Tokenizer

    try:
        check_regular(path)
        return Tokenizer.from_file(path)
    except Exception as error:  # noqa: BLE001  the library raises no other class
        why = error.strerror if isinstance(error, OSError) else error
        raise SettingError(
            f"--tokenizer: {path} can't be read: {why}",
            hint="name a model's tokenizer.json, as the tokenizers library writes it",
        ) from None
