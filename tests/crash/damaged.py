"""Files of a data root with a bit flipped, cut, emptied or deleted: each is told by its name, or
has no effect.

`kb verify` looks first, then whatever reads the file: a reader that ends well has made what it
makes of whole files, or it names the file and ends with 1. Then `kb verify --repair`, and where it
says so `kb SOURCE crawl` and `kb build`: all is as it was, or the root is told again not to be
whole.
"""

import random
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import kb
from kb import query
from kb.core.errors import DamagedData
from kb.core.progress import Progress
from kb.reader.tables import UnknownTable
from kb.store.tables.checksums import digest
from kb.verify.root import verify
from tests.crash import harm
from tests.crash.worlds import Worlds
from tests.filters.made import digests

BASE = "purged"
OUTCOMES = ("told", "no effect", "silent", "unclear", "repaired", "told again")
_MADE = ("clean", "pairs", "release")
_COUNTS = ("summary.json", ".zst", "deposits.json", "_manifest.json")


def _flip(path: Path, draw: random.Random) -> None:
    data = bytearray(path.read_bytes())
    bit = draw.randrange(len(data) * 8)
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)


def _cut(path: Path, draw: random.Random) -> None:
    path.write_bytes(path.read_bytes()[: draw.randrange(1, max(2, path.stat().st_size))])


KINDS: dict[str, Callable[[Path, random.Random], object]] = {
    "flip": _flip,
    "cut": _cut,
    "empty": lambda path, _: path.write_bytes(b""),
    "delete": lambda path, _: path.unlink(),
}


class Reader(NamedTuple):
    """Commands that read a file, and what comes of them: folders, or what the last one prints."""

    commands: tuple[tuple[str, ...], ...]
    made: str = ""
    prints: bool = False


class Place(NamedTuple):
    """A kind of files and who reads them."""

    name: str
    patterns: tuple[str, ...]
    readers: tuple[Reader, ...]


class Came(NamedTuple):
    """What came of a damaged file: one of OUTCOMES, another one of the repair, and what to say."""

    outcome: str
    repaired: str
    said: list[str]


def places(sources: tuple[str, ...]) -> list[Place]:
    """Every kind of files that a data root has."""
    made_of_pairs = (Reader((("pairs", "--format=video2dataset"),), "export"),)
    found = [place for source in sources for place in _of(source)]
    released = (Reader((("release",),), "release/pairs"),)
    return [
        *found,
        Place("pairs", ("pairs/*",), made_of_pairs),
        Place("release/pairs", ("release/pairs/*",), released),
    ]


def _of(source: str) -> Iterator[Place]:
    clean, status = f"clean/{source}", Reader((("status",),))
    filtered = Reader(((source, "filter"),), clean)
    asked = Reader(((source, "crawl"), (source, "filter")), clean)
    raw = [f"raw/{source}/*/*.zst", f"raw/{source}/*.parquet"]
    if source == "wiki":
        raw += ["raw/wiki/pages/*/*/*", "raw/wiki/images/*"]
    yield Place(f"raw/{source}", tuple(raw), (filtered, asked))
    state = (f"state/{source}.sqlite", f"state/{source}/tombstones.json")
    yield Place(f"state/{source}", state, (filtered, asked, status))
    yield Place(f"annotations/{source}", (f"annotations/{source}/*",), (filtered,))
    exported = Reader(((source, "export"),), f"release/{source}")
    searched = ("search", "the", "how", "--source", source)
    indexed = Reader((("index", "--again"), searched), prints=True)
    pairs = (Reader((("pairs", "--again"),), "pairs"),) if source == "youtube" else ()
    tables = (f"{clean}/*/*.parquet", f"{clean}/*.json")
    yield Place(clean, tables, (exported, indexed, status, *pairs))
    search = Reader((searched,), prints=True)
    yield Place(f"index/{source}", (f"index/{source}/[!.]*",), (search,))
    described = Reader((("release",),), f"release/{source}")
    yield Place(f"release/{source}", (f"release/{source}/*",), (described,))


class Spoiled:
    """One place's files, damaged one after the other in a folder of its own."""

    def __init__(self, made: Worlds, place: Place, folder: Path) -> None:
        self.place, self._folder, self.base = place, folder, made.base(BASE)
        self.root = folder / "data"
        self._env = made.env | {"KB_DATA": str(self.root)}
        self._whole: dict[object, object] = {}
        found = {path for pattern in place.patterns for path in self.base.glob(pattern)}
        self.files = sorted(path.relative_to(self.base) for path in found if path.is_file())

    def came(self, kind: str, file: Path, seed: object, readers: int = 9) -> Came:
        """Damage a file and look; `readers`: how many of those that read it are asked."""
        path = self.root / file

        def spoil() -> None:
            self._fresh()
            KINDS[kind](path, random.Random(f"{seed} {kind} {file}"))

        chosen = random.Random(f"{seed} {kind} {file}").sample(
            self.place.readers, min(readers, len(self.place.readers))
        )
        spoil()
        told, said = self._is_found(path), []
        looks: list[tuple[object, Callable[[], object]]] = [
            (one, partial(self._read, one, path)) for one in chosen
        ]
        if view := _view(file):
            looks.append((view, partial(self._loaded, view, path)))
        for key, look in looks:
            if key not in self._whole:
                self._fresh()
                self._whole[key] = look()
                assert not isinstance(self._whole[key], str), self._whole[key]
            spoil()
            came = look()
            told = told or came == "told"
            if isinstance(came, str) and came != "told":
                said.append(f"unclear: {kind} {file}: {key}: {came}")
            elif came != "told" and came != self._whole[key]:
                said.append(f"silent: {kind} {file}: {key}: another result")
        spoil()
        repaired = self._repaired()
        outcome = said[0].partition(":")[0] if said else "told" if told else "no effect"
        return Came(outcome, repaired, said)

    def _fresh(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        shutil.copytree(self.base, self.root, symlinks=True)

    def _is_found(self, path: Path) -> bool:
        """Whether `kb verify` tells of the file, or of the folder whose answers are lost."""
        told = {one.path for one in verify(self.root, Progress()).entries}
        return not told.isdisjoint((path, *list(path.parents)[:2]))

    def _read(self, reader: Reader, path: Path) -> object:
        """What a reader makes; "told", or what it says instead."""
        told = False
        for words in reader.commands:
            ended = harm.run(words, self._env, self._folder)
            if ended.code and "Traceback" not in ended.err and _names(ended.err, path):
                told = True  # a crawl has set it aside, and asks again in its next run
                ended = harm.run(words, self._env, self._folder)
            if ended.code:
                return "told" if told else f"{words} ended with {ended.code}: {ended.err[-600:]}"
        if reader.prints:
            return "told" if told else ended.out.splitlines()
        return self._made(reader.made) if reader.made else []

    def _made(self, folder: str) -> dict[str, str]:
        """Bytes by path, without what counts requests."""
        return {
            name: digest
            for name, digest in digests(self.root / folder).items()
            if not name.endswith(_COUNTS)
        }

    def _loaded(self, view: str, path: Path) -> object:
        """The rows of a table as kb.load and `kb query` give them, by both ways."""
        try:
            data = kb.load(self.root)
            with query.connect(self.root) as con:
                return [
                    data[view].to_pylist(),
                    data.sql(f"FROM {view}").to_pylist(),
                    query.select(con, f"FROM {view}", root=self.root).read_all().to_pylist(),
                ]
        except DamagedData as error:
            return "told" if _names(str(error), path) else str(error)
        except UnknownTable:
            return "told" if not path.exists() else f"{view} is unknown"

    def _repaired(self) -> str:
        """Whether all is as it was, or the root is told again not to be."""
        repair = ("verify", "--repair")
        ended = harm.run(repair, self._env, self._folder)
        kind, _, source = self.place.name.partition("/")
        if kind in ("raw", "annotations") or (ended.code and kind == "state"):
            for words in ((source, "crawl"), ("build", "pairs", "release"), repair):
                ended = harm.run(words, self._env, self._folder)
        if ended.code:
            return "told again" if "has problems" in ended.err else f"unclear: {ended.err[-600:]}"
        differ = [
            name
            for folder in _MADE
            for name, digest in digests(self.base / folder).items()
            if not name.endswith(_COUNTS) and _digest(self.root / folder / name) != digest
        ]
        return f"silent: repaired, and another: {differ[:4]}" if differ else "repaired"


def _names(said: str, path: Path) -> bool:
    """Whether a message names a file, or the folder that it was in."""
    return path.name in said or str(path.parent) in said


def _view(file: Path) -> str:
    """The view of a table's file, "" for one of no table."""
    match file.parts:
        case ("clean", source, table, name) if name.endswith(".parquet"):
            return f"clean.{source}_{table}"
        case ("pairs", name) if name.endswith(".parquet"):
            return "clean.pairs"
        case ("release", "pairs", name) if name.startswith("pairs-"):
            return "release.pairs"
        case ("release", source, name) if "-of-" in name and name.endswith(".parquet"):
            return f"release.{source}_{name.partition('-')[0]}"
        case (_, source, "tombstones.parquet") if file.parts[0] == "raw":
            return f"clean.{source}_tombstones"
        case ("release", source, "tombstones.ndjson"):
            return f"release.{source}_tombstones"
    return ""


def _digest(path: Path) -> str:
    return digest(path) if path.is_file() else ""


def all_places(
    made: Worlds, folder: Path, count: int, seed: int, readers: int = 9
) -> Iterator[tuple[str, str, Counter[str], list[str]]]:
    """Place, kind, how often each of OUTCOMES, and lines of what is wrong; `count` damages of
    each kind at each place.
    """
    for place in places(made.sources):
        spoiled = Spoiled(made, place, folder)
        for kind in KINDS:
            counts: Counter[str] = Counter()
            said: list[str] = []
            draw = random.Random(f"{seed} {place.name} {kind}")
            assert spoiled.files, place.name
            files = spoiled.files * (count // len(spoiled.files) + 1)
            for number, file in enumerate(draw.sample(files, count)):
                came = spoiled.came(kind, file, f"{seed} {number}", readers)
                counts.update((came.outcome, came.repaired.partition(":")[0]))
                said += came.said
                if came.repaired not in OUTCOMES:
                    said.append(f"{kind} {file}: --repair: {came.repaired}")
            yield place.name, kind, counts, said
