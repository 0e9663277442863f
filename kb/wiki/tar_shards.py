"""Screenshots and images of the wiki as flat tar shards in the WebDataset layout, with an index.

    screenshots-00000-of-0000N.tar   <page id>.png, <page id>.json
    images-00000-of-0000N.tar        <sha256>.<png|jpg|gif|svg|webp|…>, <sha256>.json
    index.ndjson                     one line a file: tar, member, offset and size of its bytes,
                                     sha256

Files that belong together have one name up to the first dot and stand side by side
(https://github.com/webdataset/webdataset). A tar has no times, owners or order of its own: the
same rows and files give the same bytes.
"""

import hashlib
import io
import json
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.export.rows import check_rows, sorted_rows
from kb.schema.tables import table
from kb.store.layout import CAPTURED
from kb.store.rawlog import sidefiles
from kb.store.rawlog.sidefiles import captured_file

TAR_BYTES = 1 << 30
_BLOCK = 512
_AT_ONCE = 64 << 10  # bytes that are copied at a time: four times those of the standard library


@dataclass(frozen=True)
class Sample:
    """One file of the data root and what is said about it; `sha256` where something says it."""

    name: str  # member name without its ending
    ending: str
    path: Path
    size: int
    about: bytes
    sha256: str | None = None

    @property
    def member(self) -> str:
        return f"{self.name}.{self.ending}"

    @property
    def packed(self) -> int:
        """Bytes that it takes in a tar, its JSON included."""
        return sum(_BLOCK + -(-size // _BLOCK) * _BLOCK for size in (self.size, len(self.about)))


def export(run: Run) -> Summary:
    """Writes release/wiki: the tables, the tars and their index.

    Raises FatalError, DamagedData, DiskFull.
    """
    pages = table("wiki/pages")
    check_rows(run.root, pages.name)
    lost: set[Path] = set()
    plan = {
        "screenshots": list(_shards(_screenshots(run.root, lost))),
        "images": list(_shards(_images(run.root, lost))),
    }
    if lost:
        raise sidefiles.lost(run.root, CAPTURED, lost)
    places = {
        str(
            sample.path.relative_to(run.root)
        ): f"{_name(kind, number, len(shards))}/{sample.member}"
        for kind, shards in plan.items()
        for number, samples in enumerate(shards)
        for sample in samples
    }
    changes = {
        "wiki/pages": _moved("screenshot_path", places),
        "wiki/images": _moved("path", places),
    }

    def write_tars(folder: Path) -> None:
        with (folder / "index.ndjson").open("w", encoding="utf-8") as index:
            for kind, shards in plan.items():
                for number, samples in enumerate(shards):
                    tar = folder / _name(kind, number, len(shards))
                    for line in _write_tar(tar, samples, lost):
                        index.write(json.dumps(line, ensure_ascii=False) + "\n")
        if lost:
            raise sidefiles.lost(run.root, CAPTURED, lost)

    summary = layouts.write_parquet(run, CAPTURED, changes=changes, add_files=write_tars)
    path = summary.pop("path")
    tars = sum(map(len, plan.values()))
    return Summary({**summary, "tars": tars, "files": len(places), "path": path})


def _screenshots(root: Path, lost: set[Path]) -> Iterator[Sample]:
    names = [
        "page_id",
        "title",
        "url",
        "revision_id",
        "license",
        "contributors_url",
        "page_width",
        "page_height",
        "device_pixel_ratio",
    ]
    for row in sorted_rows(root, "wiki/pages", [*names, "screenshot_path"], ["page_id"]):
        about = {name: row[name] for name in names}
        path = captured_file(root, row["screenshot_path"])
        yield _sample(f"{row['page_id']:09d}", path, about, lost)


def _images(root: Path, lost: set[Path]) -> Iterator[Sample]:
    """Every file once, by its hash, with what the first row says about it."""
    names = ["sha256", "media_type", "width", "height", "src", "license"]
    images: dict[str, tuple[str, dict[str, Any]]] = {}
    for row in sorted_rows(
        root,
        "wiki/images",
        [*names, "path", "page_id", "element_id", "frame_index"],
        ["page_id", "element_id", "frame_index"],
    ):
        if row["path"]:
            images.setdefault(row["sha256"], (row["path"], {name: row[name] for name in names}))
    for sha256 in sorted(images):
        path, about = images[sha256]
        yield _sample(sha256, captured_file(root, path), about, lost)


def _sample(name: str, file: Path, about: dict[str, Any], lost: set[Path]) -> Sample:
    """What goes into a tar; a file that is missing or empty is added to `lost`."""
    size = file.stat().st_size if file.is_file() else 0
    if not size:
        lost.add(file)
    text = json.dumps(about, ensure_ascii=False, sort_keys=True).encode()
    ending, sha256 = file.suffix.removeprefix("."), sidefiles.expected(file)
    return Sample(name, ending, file, size, text, sha256)


def _shards(samples: Iterator[Sample]) -> Iterator[list[Sample]]:
    shard: list[Sample] = []
    size = 0
    for sample in samples:
        if shard and size + sample.packed > TAR_BYTES:
            yield shard
            shard, size = [], 0
        shard.append(sample)
        size += sample.packed
    if shard:
        yield shard


def _name(kind: str, number: int, count: int) -> str:
    return f"{kind}-{number:05d}-of-{count:05d}.tar"


def _moved(column: str, places: dict[str, str]) -> layouts.RowTransform:
    """The released path of each file instead of the one in the data root."""

    def moved_rows(rows: pa.Table) -> pa.Table:
        moved = [None if path is None else places[path] for path in rows[column].to_pylist()]
        return rows.set_column(
            rows.column_names.index(column), column, pa.array(moved, pa.string())
        )

    return layouts.RowTransform(moved_rows, (column,))


def _write_tar(path: Path, samples: list[Sample], lost: set[Path]) -> Iterator[dict[str, Any]]:
    """Write one tar; the index lines of its members. What is not what it was goes to `lost`."""
    with tarfile.TarFile(path, "w", format=tarfile.USTAR_FORMAT, copybufsize=_AT_ONCE) as tar:
        for sample in samples:
            for member, data in (
                (sample.member, sample.path),
                (f"{sample.name}.json", sample.about),
            ):
                info = tarfile.TarInfo(member)
                info.size, info.mode, info.mtime = (
                    sample.size if isinstance(data, Path) else len(data),
                    0o644,
                    0,
                )
                digest = hashlib.sha256()
                start = tar.offset + _BLOCK
                with data.open("rb") if isinstance(data, Path) else io.BytesIO(data) as file:
                    tar.addfile(info, _Hashing(file, digest))
                if isinstance(data, Path) and sample.sha256 not in (None, digest.hexdigest()):
                    lost.add(data)
                yield {
                    "tar": path.name,
                    "member": member,
                    "offset": start,
                    "size": info.size,
                    "sha256": digest.hexdigest(),
                }


class _Hashing:
    """A file whose bytes are hashed as they are read, so that a large file is read once."""

    def __init__(self, file: Any, digest: Any) -> None:
        self._file, self._digest = file, digest

    def read(self, size: int = -1) -> bytes:
        """The next bytes."""
        data: bytes = self._file.read(size)
        self._digest.update(data)
        return data
