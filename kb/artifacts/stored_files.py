"""Reads screenshots and images where their rows say that they are: a data root's files, or members
of the tars of a release, here or at an address.
"""

from __future__ import annotations

import hashlib
import json
import tarfile
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from kb.artifacts.release_folder import INDEX
from kb.core.errors import DamagedData
from kb.store.damage import DOWNLOAD, missing, open_file, opening, unreadable
from kb.store.rawlog.sidefiles import read_captured
from kb.store.tables.checksums import opened, short_lines
from kb.store.tables.remote_files import RemoteFolder, reading_at

_BYTES = 200_000_000  # of a file


def stored_file(home: Path | RemoteFolder, path: str) -> tuple[bytes, str]:
    """The bytes of a screenshot or image, and where they are: `<tar>/<member>` of a release, or a
    data root's file. Raises DamagedData.
    """
    tar, slash, member = path.partition("/")
    if isinstance(home, RemoteFolder):
        return _remote_member(home, tar, member), f"{home}/{tar}: {member}"
    if slash and tar.endswith(".tar") and "/" not in member:
        return _member(home / tar, member), f"{home / tar}: {member}"
    return read_captured(home, path), str(home / path)


def _member(tar: Path, member: str) -> bytes:
    if not tar.exists():
        raise missing([tar], "download it into the folder of the tables")
    index = tar.parent / INDEX
    entries = _read(index, index.stat().st_mtime_ns) if index.exists() else {}
    entry = entries.get((tar.name, member))
    if entry is None:
        return _searched(tar, member)
    with opening(tar), open_file(tar, DOWNLOAD) as file:  # the entry describes the very bytes
        return _verified(file, entry, str(tar))


def _remote_member(folder: RemoteFolder, tar: str, member: str) -> bytes:
    entry = _remote_index(folder).get((tar, member))
    if entry is None or tar not in folder.sizes:
        raise DamagedData(f"{folder} has no {tar}/{member}", hint="publish the release again")
    with folder.open(tar) as file, reading_at(f"{folder}/{tar}"):
        return _verified(file, entry, f"{folder}/{tar}")


def _verified(file: BinaryIO, entry: dict[str, Any], tar: str) -> bytes:
    file.seek(entry["offset"])
    data = file.read(entry["size"])
    if hashlib.sha256(data).hexdigest() != entry["sha256"]:
        member = entry["member"]
        raise DamagedData(f"{tar} is damaged: checksum mismatch of {member}", hint=DOWNLOAD)
    return data


def _searched(tar: Path, member: str) -> bytes:
    """A member found without an index, by reading the tar from its start."""
    try:
        with opened(tar, DOWNLOAD) as stored, tarfile.open(fileobj=stored, mode="r:") as archive:
            entry = archive.getmember(member)
            file = archive.extractfile(entry) if entry.isreg() and entry.size <= _BYTES else None
            if file is not None:
                return file.read()
    except (tarfile.TarError, KeyError, OSError, ValueError, RecursionError) as error:
        raise DamagedData(f"{tar} has no {member}: {error}", hint=DOWNLOAD) from None
    raise DamagedData(f"{tar} has no {member}", hint=DOWNLOAD)


@lru_cache(maxsize=4)
def _read(path: Path, changed: int) -> dict[tuple[str, str], dict[str, Any]]:
    return _entries(short_lines(path, DOWNLOAD), str(path))


@lru_cache(maxsize=4)
def _remote_index(folder: RemoteFolder) -> dict[tuple[str, str], dict[str, Any]]:
    return _entries(folder.read_file(INDEX).splitlines(), f"{folder}/{INDEX}")


def _entries(lines: Iterable[bytes], place: str) -> dict[tuple[str, str], dict[str, Any]]:
    members = {}
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            members[entry["tar"], entry["member"]] = entry
            valid = isinstance(entry["sha256"], str) and all(
                type(entry[name]) is int and 0 <= entry[name] <= most
                for name, most in (("offset", 1 << 62), ("size", _BYTES))
            )
            if not valid:
                raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise unreadable(place, f"line {number} is not an entry", DOWNLOAD) from None
    return members
