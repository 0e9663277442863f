"""What a reconstruction or a purge is asked for: full names, a released Parquet file, the published
`reddit.json`.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import NamedTuple, cast

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.errors import SettingError
from kb.core.resources import PROFILE_FILE
from kb.store import parquet

Ids = Path | str | Iterable[str | Path] | None
"""A file or folder of ids, several of them, or full names; None: the data root's own release."""

_NAME = re.compile(r"t[13]_[0-9a-z]{1,13}\Z")


class Wanted(NamedTuple):
    """`names`: full names to ask for by `info`. `trees`: bare ids of posts whose whole trees are to
    be fetched.
    """

    names: list[str] | Files | Several
    trees: list[str]

    def digest(self) -> str:
        """Tells what is wanted from anything else. Raises SettingError where a released file is
        damaged.
        """
        found = hashlib.sha256()
        for start, names in ((b"[[", self.names), (b"],[", self.trees)):
            found.update(start)
            for number, name in enumerate(names):
                found.update(f'{"," if number else ""}"{name}"'.encode())
        found.update(b"]]")
        return found.hexdigest()[:16]


class Several:
    """Full names of several sources, one after the other; a name may stand in more than one."""

    def __init__(self, parts: Sequence[list[str] | Files | Several]) -> None:
        self._parts = parts

    def __len__(self) -> int:
        return sum(map(len, self._parts))

    def __iter__(self) -> Iterator[str]:
        return chain.from_iterable(self._parts)


class Files:
    """Full names in Parquet files: read whenever they are iterated, never held. Raises
    SettingError.
    """

    def __init__(self, files: list[Path]) -> None:
        self._columns = [(path, *_column(path)) for path in files]
        self._rows = sum(parquet.footer(path).num_rows for path in files)

    def __len__(self) -> int:
        return self._rows

    def __iter__(self) -> Iterator[str]:
        for path, column, prefix in self._columns:
            with _unreadable(path), parquet.open_file(path) as file:
                for batch in file.iter_batches(columns=[column]):
                    yield from (prefix + str(key) for key in batch.column(0).to_pylist())


def asked_for(ids: Ids, release: Path) -> tuple[Wanted, list[Path]]:
    """What is wanted, and the files and folders that it stands in. `ids` as for a reconstruction.

    Without `ids` it is the data root's own `release`. Raises SettingError.
    """
    if ids is None:
        if not release.is_dir():
            raise SettingError(
                f"there is no release to take ids from at {release}",
                hint="name what to bring back, as in `kb reddit reconstruct --ids release/reddit`, "
                "or make one first with `kb reddit export`",
            )
        return read_wanted(release), [release]
    if isinstance(ids, (str, Path)):
        return read_wanted(Path(ids)), [Path(ids)]
    ids = list(ids)
    paths = [one for one in ids if isinstance(one, Path)]
    if not paths:
        return read_names(cast("list[str]", ids), "ids"), []
    found = [read_wanted(Path(one)) for one in ids]
    if len(found) == 1:
        return found[0], paths
    trees = dict.fromkeys(key for one in found for key in one.trees)
    return Wanted(Several([one.names for one in found]), list(trees)), [Path(one) for one in ids]


def subreddit_of(sources: Sequence[Path]) -> str:
    """The subreddit that all ids of these sources are of, by the profiles in release folders.

    "" where nobody says so: ids of a list may be of any.
    """
    said = {_subreddit(one) for one in sources}
    return said.pop() if len(said) == 1 else ""


def _subreddit(folder: Path) -> str:
    try:
        profile = tomllib.loads((folder / PROFILE_FILE).read_text(encoding="utf-8"))
        name = profile["reddit"]["subreddit"]
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    return name if isinstance(name, str) else ""


def read_wanted(path: Path) -> Wanted:
    """The ids of a file in its order, without duplicates but for Parquet. Raises SettingError (exit
    2).

    Lines: a full name each. Parquet: `comment_id`, else `post_id`, else full names in `key`. JSON:
    a list of objects with `id` (bare, as MineDojo published it). A folder: the Parquet files of a
    release in it.
    """
    with _unreadable(path):
        if path.is_dir():
            files = sorted(
                [*path.glob("posts-*.parquet"), *path.glob("comments-*.parquet")],
                key=lambda file: (file.name[0] == "c", file.name),
            )
            if not files:
                raise SettingError(
                    f"{path} holds no released posts or comments",
                    hint="give --ids PROFILE_FILE, or run `kb reddit export` first",
                )
            return _some(Files(files))
        with path.open("rb") as file:
            start = file.read(4)
        if start == b"PAR1":
            return _some(Files([path]))
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix == ".json" or text.lstrip().startswith("["):
            return _published(path, text)
    return read_names(text.splitlines(), str(path))


@contextmanager
def _unreadable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SettingError(f"--ids {path}: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise SettingError(f"--ids {path} can't be read: {str(error).splitlines()[0]}") from None


def read_names(lines: Iterable[str], where: str) -> Wanted:
    """Full names, one a line. Raises SettingError naming the first line that is no full name."""
    found = []
    for number, line in enumerate(lines, 1):
        name = line.strip().lower()
        if not name:
            continue
        if not _NAME.match(name):
            raise SettingError(
                f"{where}, line {number}: {line.strip()[:40]!r} is no full name",
                hint="write posts as t3_… and comments as t1_…",
            )
        found.append(name)
    return _some(list(dict.fromkeys(found)))


class Released(NamedTuple):
    """What a release says of its rows and an answer by id can't: each (id, value), None where no
    file has it.

    `depths` of comments whose ancestors may be gone by now; `unread` comments of posts.
    """

    depths: pa.Table | None
    unread: pa.Table | None


def released(sources: Sequence[Path]) -> Released:
    """What the released tables among these files and folders say."""
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
    found = []
    columns: list[tuple[str, pa.DataType]] = [(key, pa.string()), (name, pa.int64())]
    for file in files:
        with file.open("rb") as opened:
            if opened.read(4) != b"PAR1":
                continue
        if {key, name} <= set(pq.read_schema(file).names):
            rows = parquet.read_table(file, columns=[key, name])
            found.append(rows.cast(pa.schema(columns)))
    return pa.concat_tables(found) if found else None


def _some(names: list[str] | Files) -> Wanted:
    if not len(names):
        raise SettingError(
            "there are no ids to ask for",
            hint="give --ids PROFILE_FILE with full names, a released Parquet file or reddit.json",
        )
    return Wanted(names, [])


def _column(path: Path) -> tuple[str, str]:
    """The column that names things, and what makes full names of its values."""
    columns = pq.read_schema(path).names
    for column, prefix in (("comment_id", "t1_"), ("post_id", "t3_"), ("key", "")):
        if column in columns:
            return column, prefix
    raise SettingError(
        f"--ids {path} has no column comment_id, post_id or key; it has {', '.join(columns)}"
    )


def _published(path: Path, text: str) -> Wanted:
    data = json.loads(text)
    if not isinstance(data, list):
        raise SettingError(
            f"--ids {path} is no list",
            hint="MineDojo's reddit.json is a list of objects with an id",
        )
    ids = [
        str(entry.get("id") or "" if isinstance(entry, dict) else entry).removeprefix("t3_").lower()
        for entry in data
    ]
    for number, key in enumerate(ids, 1):
        if not _NAME.match(f"t3_{key}"):
            raise SettingError(f"--ids {path}: entry {number} has no Reddit id")
    if not ids:
        raise SettingError(f"--ids {path} is empty")
    return Wanted([], list(dict.fromkeys(ids)))
