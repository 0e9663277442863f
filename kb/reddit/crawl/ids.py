"""What a reconstruction or a purge is asked for, by any list that kb.crawl.id_list reads.

Full names (t3_…, t1_…) and addresses of posts and comments are asked for one by one. Bare ids in
JSON are those of MineDojo's `reddit.json`, which names no comments: whole trees are fetched.
"""

import hashlib
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import pyarrow as pa

from kb.core.errors import DamagedData, SettingError
from kb.core.installation import PROFILE_FILE
from kb.crawl.id_list import (
    IdRules,
    ListedId,
    column_of,
    files_of,
    is_parquet,
    readable,
)
from kb.store.tables import parquet
from kb.store.tables.checksums import read_small

Ids = Path | str | Iterable[str | Path] | None
"""A file or folder of ids, several of them, or full names; None: the data root's own release."""

_NAME = re.compile(r"t[13]_[0-9a-z]{1,13}")
_BARE = re.compile(r"[0-9a-z]{1,13}")
# Reddit's own hosts, or none: a permalink is a path.
_ADDRESS = re.compile(
    r"(?:(?:https?:)?//)?(?:[a-z0-9-]+\.)*(?:reddit\.com(?::\d+)?)?(?:/(?:r|u|user)/[^/?#]+)?"
    r"/(?:comments|gallery)/([0-9a-z]{1,13})(?:/[^/?#]*(?:/([0-9a-z]{1,13}))?)?/?(?:[?#].*)?"
)
_SHORT = re.compile(r"(?:(?:https?:)?//)?(?:www\.)?redd\.it/([0-9a-z]{1,13})()/?(?:[?#].*)?")
_PREFIXES = {"comment_id": "t1_", "post_id": "t3_", "key": "", "name": "", "fullname": ""}


def _address(text: str) -> re.Match[str] | None:
    """The bare ids of an address: of a post, and of a comment or nothing."""
    return _ADDRESS.fullmatch(text) or _SHORT.fullmatch(text)


def _key(entry: ListedId) -> str | None:
    """A full name, or the bare id of a post whose tree is meant."""
    text = str(entry.value).strip().lower()
    if match := _address(text):
        return f"t1_{match[2]}" if match[2] else f"t3_{match[1]}"
    if entry.column in ("id", "[]"):
        text = text.removeprefix("t3_")
        return text if _BARE.fullmatch(text) or _NAME.fullmatch(text) else None
    prefix = _PREFIXES.get(entry.column, "")
    text = text if text.startswith(prefix) else prefix + text
    return text if _NAME.fullmatch(text) else None


def _is_full_name(text: str) -> bool:
    return bool(_NAME.fullmatch(text) or (text[:4] == "http" and _address(text.lower())))


RULES = IdRules(
    option="--ids",
    noun="full names of posts or comments",
    hint="give --ids FILE: posts as t3_… and comments as t1_… one a line, a released Parquet file"
    " or MineDojo's reddit.json",
    columns=(*_PREFIXES, "id", "permalink"),
    tables=(("posts", "comments"),),
    parse=_key,
    is_unmistakable=_is_full_name,
)


class FullNames:
    """Full names of lists, then those in Parquet files, which are read whenever they are iterated
    and never held; one may come more than once. Raises SettingError.
    """

    def __init__(self, listed: Sequence[str], files: Sequence[Path]) -> None:
        self.listed, self.files = listed, files
        columns = [(path, column_of(path, RULES.option, tuple(_PREFIXES))) for path in files]
        self._columns = [(path, column, _PREFIXES[column]) for path, column in columns]
        self._rows = sum(parquet.footer(path).num_rows for path in files)

    def __len__(self) -> int:
        return len(self.listed) + self._rows

    def __iter__(self) -> Iterator[str]:
        yield from self.listed
        for path, column, prefix in self._columns:
            with readable(path, RULES.option), parquet.open_file(path) as file:
                for batch in file.iter_batches(columns=[column]):
                    yield from (prefix + str(key) for key in batch.column(0).to_pylist())


class WantedThings(NamedTuple):
    """`names`: full names to ask for by `info`. `trees`: bare ids of posts whose whole trees are to
    be fetched. `bad_lines` of text are neither.
    """

    names: FullNames
    trees: list[str]
    bad_lines: int = 0

    def digest(self) -> str:
        """Tells what is wanted from anything else. Raises SettingError where a released file is
        damaged.
        """
        digest = hashlib.sha256()
        for start, names in ((b"[[", self.names), (b"],[", self.trees)):
            digest.update(start)
            for number, name in enumerate(names):
                digest.update(f'{"," if number else ""}"{name}"'.encode())
        digest.update(b"]]")
        return digest.hexdigest()[:16]


def asked_for(
    ids: Ids, release: Path, say: Callable[[str], None] | None = None
) -> tuple[WantedThings, list[Path]]:
    """What is wanted, and the files and folders that it stands in. `ids` as for a reconstruction.

    Without `ids` it is the data root's own `release`. `say` gets one line for each list with
    entries that are not ids. Raises SettingError.
    """
    if ids is None:
        if not release.is_dir():
            raise SettingError(
                f"there is no release with ids at {release}",
                hint="name what to bring back, as in `kb reddit reconstruct --ids release/reddit`, "
                "or make one first with `kb reddit export`",
            )
        ids = release
    given = [Path(ids)] if isinstance(ids, (str, Path)) else list(ids)
    if not any(isinstance(entry, Path) for entry in given):
        return _named(cast("list[str]", given)), []
    paths = [Path(entry) for entry in given]
    lists = [read_wanted(path, say) for path in paths]
    listed = [name for wanted in lists for name in wanted.names.listed]
    files = [file for wanted in lists for file in wanted.names.files]
    trees = dict.fromkeys(key for wanted in lists for key in wanted.trees)
    bad_lines = sum(wanted.bad_lines for wanted in lists)
    return WantedThings(FullNames(listed, files), list(trees), bad_lines), paths


def subreddit_of(sources: Sequence[Path]) -> str:
    """The subreddit that all ids of these sources are of, by the profiles in release folders.

    "" where it is not known: a list may have ids of any.
    """
    names = {_subreddit(folder) for folder in sources}
    return names.pop() if len(names) == 1 else ""


def _subreddit(folder: Path) -> str:
    try:
        profile = tomllib.loads(read_small(folder / PROFILE_FILE).decode())
        name = profile["reddit"]["subreddit"]
    except (DamagedData, ValueError, KeyError, TypeError, RecursionError):
        return ""
    return name if isinstance(name, str) else ""


def read_wanted(path: Path, say: Callable[[str], None] | None = None) -> WantedThings:
    """The ids of a list in its order, without duplicates but for Parquet. Raises SettingError (exit
    2), also where there are none.
    """
    with readable(path, RULES.option):
        if path.is_dir() or is_parquet(path):
            names = FullNames([], files_of(path, RULES))
            if not len(names):
                raise SettingError(f"--ids {path} contains no ids", hint=RULES.hint)
            return WantedThings(names, [])
    listed = RULES.some_ids_in(path, say)
    trees = [key for key in listed.keys if not _NAME.fullmatch(key)]
    full = [key for key in listed.keys if _NAME.fullmatch(key)]
    return WantedThings(FullNames(full, []), trees, listed.bad_lines)


def _named(names: Iterable[str]) -> WantedThings:
    """Full names as they are. Raises SettingError for what is none, and for none at all."""
    keys = {name: _key(ListedId(name)) for name in names}
    wrong = next((name for name, key in keys.items() if key is None), None)
    if wrong is not None or not keys:
        what = f"{wrong[:40]!r} is not a full name" if wrong is not None else "no ids to ask for"
        raise SettingError(what, hint=RULES.hint)
    full = dict.fromkeys(key for key in keys.values() if key is not None)
    return WantedThings(FullNames([*full], []), [])


class Released(NamedTuple):
    """What a release says of its rows and an answer by id can't: each (id, value), None where no
    file has it.

    `depths` of comments whose ancestors may be gone by now; `unread` comments of posts.
    """

    depths: pa.Table | None
    unread: pa.Table | None


def released(sources: Sequence[Path]) -> Released:
    return Released(
        _column_of(sources, "comments", "comment_id", "depth"),
        _column_of(sources, "posts", "post_id", "comments_unread"),
    )


def _column_of(sources: Sequence[Path], short: str, key: str, name: str) -> pa.Table | None:
    files = [
        file
        for path in sources
        for file in (sorted(path.glob(f"{short}-*.parquet")) if path.is_dir() else [path])
    ]
    tables = []
    columns: list[tuple[str, pa.DataType]] = [(key, pa.string()), (name, pa.int64())]
    for file in files:
        if is_parquet(file) and {key, name} <= set(parquet.names(file)):
            rows = parquet.read_table(file, columns=[key, name])
            tables.append(rows.cast(pa.schema(columns)))
    return pa.concat_tables(tables) if tables else None
