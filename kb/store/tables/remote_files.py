"""Folders that are read where they lie, at any address that fsspec knows.

    folder, *inner = remote_folders("hf://datasets/ORG/NAME")
    folder.dataset(["videos-00000-of-00001.parquet"])     # a pyarrow Dataset: reads what is asked

Of a Parquet file only the footer and the pages that a query needs are read, and every page is
verified by its checksum; other files are read whole and verified by SHA256SUMS. Nothing is written
but what a web server without byte ranges sends: each file once, whole, to a temporary place that
goes with the process. An address such as `blockcache::s3://…` keeps blocks in a folder of the
user's choice.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import socket
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Self, cast

import pyarrow as pa
import pyarrow.fs

from kb.core import terminal
from kb.core.cached_property import cached_property
from kb.core.config.addresses import is_loopback
from kb.core.errors import (
    DamagedData,
    FatalError,
    KbError,
    MissingExtra,
    SettingError,
    Unreachable,
)
from kb.core.installation import ds, fsspec, fsspec_cached, install_extra
from kb.net.certificates import causes, tls, untrusted
from kb.net.hub_client import use_own_client
from kb.net.proxies import proxy_of
from kb.store.artifact_registry import SUMS
from kb.store.damage import unreadable
from kb.store.tables.checksums import MISMATCH, parsed

_EXTRAS = {"s3": "s3", "s3a": "s3", "hf": "hub"}
# What clients raise for a refused or missing credential, by the name of its class.
_REFUSED = {"PermissionError", "NoCredentialsError", "GatedRepoError", "PartialCredentialsError"}
_S3_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
_HTTP = {"http", "https"}
_TURN = threading.RLock()  # of the threads that read files of one client
_PART = 2  # bytes: of a smaller file there are no parts
_PAGE = "page integrity"  # in Arrow's message of a page with another checksum
_NO_CONNECTION = (ConnectionError, TimeoutError, socket.gaierror)
_CHECK = "check the address and the network"
MOST_COPIED = 2_000_000_000  # bytes of a folder that are read whole where there are no ranges


@dataclass(frozen=True, eq=False)
class RemoteFolder:
    """A folder and the sizes of its files in bytes, by name. `failures`: of reads by DuckDB, which
    keeps only an error's text.
    """

    address: str
    system: fsspec.AbstractFileSystem
    path: str
    sizes: Mapping[str, int]
    failures: list[KbError] = field(default_factory=list)

    def __str__(self) -> str:
        return self.address

    def open(self, name: str) -> BinaryIO:
        """A file to read and seek in. Raises FatalError."""
        with reading_at(f"{self.address}/{name}"):
            if not self.sends_ranges:
                return self._copies.copy_of(name).open("rb")
            return cast("BinaryIO", _open(self.system, f"{self.path}/{name}"))

    def read_file(self, name: str) -> bytes:
        """A whole file. Raises DamagedData for another checksum than in SHA256SUMS."""
        with self.open(name) as file, reading_at(f"{self.address}/{name}"):
            data = file.read()
        if name != SUMS and hashlib.sha256(data).hexdigest() != self.sums.get(name):
            raise unreadable(f"{self.address}/{name}", MISMATCH, "publish it again")
        return data

    @cached_property
    def sums(self) -> dict[str, str]:
        """SHA-256 of each file, from SHA256SUMS. Raises DamagedData where there is none."""
        if SUMS not in self.sizes:
            raise DamagedData(
                f"{self.address} has no {SUMS}", hint="it is not a whole release folder"
            )
        return parsed(self.read_file(SUMS).decode(errors="replace"))[0]

    @cached_property
    def sends_ranges(self) -> bool:
        """Whether parts of files can be read: all but some web servers send them."""
        if _HTTP.isdisjoint(self.system.protocol):
            return True
        smallest = min(self.sizes, key=lambda name: (self.sizes[name] < _PART, self.sizes[name]))
        with reading_at(f"{self.address}/{smallest}"):
            try:
                with _open(self.system, f"{self.path}/{smallest}") as file:
                    file.seek(1)
                    return len(file.read(1)) == 1
            except ValueError:  # what the client says of a server that sends all
                return False

    @cached_property
    def _copies(self) -> _Copies:
        return _Copies(self)

    def dataset(self, names: Sequence[str]) -> ds.Dataset:
        """Parquet files as one dataset. Raises DamagedData, FatalError."""
        with reading_at(f"{self.address}/{names[0]}"):
            if not self.sends_ranges:
                return parquet_dataset([str(self._copies.copy_of(name)) for name in names])
            handler = _RangeHandler(self.system)  # type: ignore[abstract]  # stubs miss them
            paths = [f"{self.path}/{name}" for name in names]
            return parquet_dataset(paths, pyarrow.fs.PyFileSystem(handler))


class _Copies:
    """Files of a folder whose server sends them whole, in a temporary place."""

    def __init__(self, folder: RemoteFolder) -> None:
        self._folder, self._lock = folder, threading.Lock()
        self._place = tempfile.TemporaryDirectory(prefix="lorecrawl-address-")
        self._bytes = 0

    def copy_of(self, name: str) -> Path:
        """The copy of a file, which is read the first time. Raises FatalError where all copies
        would be larger than MOST_COPIED.
        """
        path = Path(self._place.name, name)
        with self._lock:
            if not path.exists():
                self._bytes += self._folder.sizes[name]
                if self._bytes > MOST_COPIED:
                    raise FatalError(
                        f"{self._folder}/{name} can't be read here: the web server sends whole"
                        f" files only, and together they would be {terminal.size(self._bytes)};"
                        f" at most {terminal.size(MOST_COPIED)} are",
                        hint="download the release, or take a server that sends byte ranges",
                    )
                part = path.with_suffix(".part")
                self._folder.system.get_file(f"{self._folder.path}/{name}", str(part))
                part.replace(path)
        return path


def parquet_dataset(
    files: Sequence[str], system: pyarrow.fs.FileSystem | None = None
) -> ds.Dataset:
    """The files, in order, of this machine or of another file system; every page that is read is
    verified.
    """
    verified = ds.ParquetFileFormat(
        default_fragment_scan_options=ds.ParquetFragmentScanOptions(page_checksum_verification=True)
    )
    return ds.dataset(list(files), format=verified, filesystem=system)


class _RangeHandler(pyarrow.fs.FSSpecHandler):
    """Opens files without fsspec's read-ahead: Arrow asks for the ranges that it needs, and block
    sizes of several MB would make each of them larger.
    """

    def open_input_file(self, path: str) -> pa.PythonFile:
        return pa.PythonFile(_open(self.fs, path), mode="r")


def remote_folders(address: str, options: Mapping[str, Any] | None = None) -> list[RemoteFolder]:
    """The folder at an address and those directly below it, if they have files.

    `options`: what fsspec calls storage options, such as `{"anon": True}`. Raises SettingError for
    an unknown kind of address or a folder that does not exist, MissingExtra without the client that
    it needs, FatalError without permission or connection.
    """
    with reading_at(address):
        if "hf://" in address:
            use_own_client(
                str((options or {}).get("endpoint") or os.environ.get("HF_ENDPOINT", ""))
            )
        given = dict(options or {})
        system, path = fsspec.core.url_to_fs(address, **_ways(address, given), **given)
        path = path.rstrip("/")
        listed = system.find(path, maxdepth=2, detail=True)
        folders: dict[str, dict[str, int]] = {}
        for full, about in sorted(listed.items()):
            # A web server's listing has names alone: each file is asked for its size.
            size = system.size(full) if about["size"] is None else about["size"]
            if size is None:
                raise FatalError(
                    f"{full}: the server does not say how large it is",
                    hint="download the release, or take a server that tells sizes and sends ranges",
                )
            folder, _, name = full.rpartition("/")
            folders.setdefault(folder, {})[name] = int(size)
    if not folders:
        with reading_at(address):  # a walk passes over what it can't reach
            system.info(path)
        raise _missing(address)
    return [
        RemoteFolder(address.rstrip("/") + folder.removeprefix(path), system, folder, sizes)
        for folder, sizes in folders.items()
    ]


def _ways(address: str, options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """By protocol how it is asked: an address of the web through its proxy, with the certificates
    that the environment names. S3's client looks there itself, for this machine too.
    """
    url = address.rpartition("::")[2]
    protocol = url.partition(":")[0]
    if protocol in options:
        return {}
    if protocol in ("http", "https"):
        way = {"proxy": proxy_of(url), "ssl": tls()}
        return {protocol: {name: value for name, value in way.items() if value is not None}}
    endpoints = (options.get("endpoint_url"), *map(os.environ.get, _S3_ENDPOINTS))
    endpoint = next(filter(None, endpoints), "")
    if protocol in ("s3", "s3a") and is_loopback(endpoint) and "config_kwargs" not in options:
        return {protocol: {"config_kwargs": {"proxies": {}}}}
    return {}


def _open(system: fsspec.AbstractFileSystem, path: str) -> Any:
    caches = isinstance(system, fsspec_cached.CachingFileSystem)
    # A cache asks the client below for just its blocks, and sets this itself.
    options = {} if caches else {"cache_type": "none"}
    # Several threads read at once. Asynchronous clients and Hugging Face's support that; others may
    # share one connection (FTP), one position (tar) or one table of blocks (caches).
    if isinstance(system, fsspec.asyn.AsyncFileSystem) or system.protocol == "hf":
        return system.open(path, mode="rb", **options)
    with _TURN:
        return _TurnTaker(system.open(path, mode="rb", **options))


class _TurnTaker:
    """A file of a client that only one thread at a time may use."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._file, name)
        if not callable(attribute):
            return attribute

        def in_turn(*given: Any) -> Any:
            with _TURN:
                return attribute(*given)

        return in_turn

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:  # Arrow forgets files without closing them
        self.close()


@contextlib.contextmanager
def reading_at(address: str) -> Iterator[None]:
    """Raises what clients and Arrow say of an address as errors that name it: SettingError,
    MissingExtra, FatalError, DamagedData, Untrusted, Unreachable.
    """
    try:
        yield
    except KbError:
        raise
    except ImportError as error:
        protocol = address.rpartition("::")[2].partition(":")[0]
        extra = _EXTRAS.get(protocol)
        raise MissingExtra(
            f"{address}: {_line(error)}",
            hint=install_extra(extra) if extra else "install the package that it names",
        ) from None
    except Exception as error:
        if problem := untrusted(error, address):
            raise problem from None
        status = getattr(getattr(error, "response", None), "status_code", None)
        if isinstance(error, FileNotFoundError):
            raise _missing(address) from None
        refused = not _REFUSED.isdisjoint(kind.__name__ for kind in type(error).__mro__)
        if refused or status in (401, 403):
            raise FatalError(
                f"{address}: no permission to read it ({_line(error)})",
                hint="give a credential as its service documents it, such as HF_TOKEN or"
                " AWS_ACCESS_KEY_ID",
            ) from None
        if isinstance(error, pa.ArrowException) or _PAGE in str(error):
            raise unreadable(address, _line(error), "publish it again") from None
        if isinstance(error, ValueError) and "rotocol not known" in str(error):
            raise SettingError(
                f"{address}: {_line(error)}", hint="use hf://, s3:// or another of fsspec's"
            ) from None
        silent = any(isinstance(cause, _NO_CONNECTION) for cause in causes(error))
        kind = Unreachable if silent else FatalError
        raise kind(f"{address} can't be read: {_line(error)}", hint=_CHECK) from error


def _missing(address: str) -> SettingError:
    return SettingError(
        f"there is no {address}", hint="check the address; without permission it looks the same"
    )


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")


def first_rows(rows: ds.Dataset, count: int) -> pa.Table:
    """Row group by row group: a scan of the dataset reads many of them ahead."""
    parts = [rows.schema.empty_table()]
    for fragment in rows.get_fragments():
        in_files = isinstance(fragment, ds.ParquetFileFragment)
        for group in fragment.split_by_row_group() if in_files else [fragment]:
            missing = count - sum(map(len, parts))
            if missing <= 0:
                return pa.concat_tables(parts)
            parts.append(group.head(missing))
    return pa.concat_tables(parts)
