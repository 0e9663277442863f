"""A data set repository of the hub: commits of whole trees, one branch, tags.

Bytes are kept in memory, by digest. A file is an LFS object when it is binary or large, else a git
blob; a tree names both by the digests that git and LFS give them.
"""

import hashlib
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

MAIN = "main"
LARGE = 10 * 2**20  # bytes; the hub keeps a larger file as an LFS object, text or not
BINARY = {".parquet", ".tar", ".zst", ".gz", ".png", ".jpg", ".gif", ".webp", ".pdf", ".bin"}
STAMP = "2026-11-20T12:00:00.000Z"
ATTRIBUTES = "".join(
    f"*{suffix} filter=lfs diff=lfs merge=lfs -text\n" for suffix in sorted(BINARY)
).encode()


def is_lfs(path: str, sample: bytes, size: int) -> bool:
    """Whether the hub keeps a file as an LFS object."""
    binary = PurePosixPath(path).suffix in BINARY or b"\0" in sample
    return size > 0 and (binary or size > LARGE)


@dataclass(frozen=True)
class StoredFile:
    """A file of a tree: `oid` is git's digest of what the tree holds, `sha256` LFS's of the bytes
    (empty for a git blob).
    """

    oid: str
    size: int
    data: bytes = field(repr=False)
    sha256: str = ""

    @property
    def etag(self) -> str:
        """What identifies the bytes."""
        return self.sha256 or self.oid

    def shown(self, path: str, *, commit: "Commit | None" = None) -> dict[str, Any]:
        """An entry of a tree; with `commit` as the expanded form has it."""
        lfs = {"lfs": {"oid": self.sha256, "size": self.size, "pointerSize": len(_pointer(self))}}
        security = {
            "status": "safe",
            "avScan": None,
            "pickleImportScan": None,
        }
        last = (
            {"lastCommit": commit.shown_short(), "securityFileStatus": security} if commit else {}
        )
        entry = {"type": "file", "path": path, "size": self.size, "oid": self.oid}
        return entry | (lfs if self.sha256 else {}) | last


def git_blob(data: bytes) -> StoredFile:
    """A file that git itself keeps."""
    return StoredFile(_git_oid(data), len(data), data)


def lfs_object(data: bytes) -> StoredFile:
    """A file of which git keeps a pointer."""
    one = StoredFile("", len(data), data, hashlib.sha256(data).hexdigest())
    return StoredFile(_git_oid(_pointer(one)), one.size, data, one.sha256)


def _git_oid(data: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(data) + data).hexdigest()


def _pointer(file: StoredFile) -> bytes:
    return (
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{file.sha256}\nsize {file.size}\n"
    ).encode()


@dataclass(frozen=True)
class Commit:
    """A revision: every file by its path."""

    id: str
    title: str
    message: str
    author: str
    files: dict[str, StoredFile] = field(repr=False)

    def shown(self) -> dict[str, Any]:
        """The commit in a list of commits."""
        more = {"message": self.message, "authors": [{"user": self.author}]}
        return self.shown_short() | more

    def shown_short(self) -> dict[str, Any]:
        """The commit as the last one of a file."""
        return {"id": self.id, "title": self.title, "date": STAMP}

    def below(self, folder: str, *, recursive: bool) -> dict[str, StoredFile | None]:
        """What lies in a folder, by path; None is a folder. Empty where there is none."""
        start = f"{folder}/" if folder else ""
        found: dict[str, StoredFile | None] = {}
        for path, file in sorted(self.files.items()):
            if not path.startswith(start):
                continue
            inner = path[len(start) :].split("/")
            depths = range(1, len(inner)) if recursive else range(1, min(2, len(inner)))
            for depth in depths:
                found[start + "/".join(inner[:depth])] = None
            if recursive or len(inner) == 1:
                found[path] = file
        return found


class Repository:
    """One data set: its commits from the oldest to the newest, and its tags."""

    def __init__(self, name: str, *, private: bool, author: str) -> None:
        self.name, self.private = name, private
        self.objects: dict[str, bytes] = {}  # LFS objects that were uploaded, by SHA-256
        self.tags: dict[str, Commit] = {}
        self.commits: list[Commit] = []
        self.commit({".gitattributes": git_blob(ATTRIBUTES)}, "initial commit", "", author)

    @property
    def head(self) -> Commit:
        """The newest revision."""
        return self.commits[-1]

    def commit(self, files: dict[str, StoredFile], title: str, message: str, author: str) -> Commit:
        """A new revision that holds exactly `files`."""
        parent = self.commits[-1].id if self.commits else ""
        names = "\n".join(f"{path} {file.oid}" for path, file in sorted(files.items()))
        number = hashlib.sha1(f"{self.name}\n{parent}\n{title}\n{names}".encode()).hexdigest()
        self.commits.append(Commit(number, title, message, author, files))
        return self.head

    def squash(self, title: str, author: str) -> None:
        """Keep the newest tree as the only revision of the branch; tags stay as they are."""
        files = self.head.files
        self.commits.clear()
        self.commit(files, title, "", author)

    def revision(self, name: str) -> Commit | None:
        """A revision by branch, tag or (the beginning of) its id; None where there is none."""
        if name in (MAIN, f"refs/heads/{MAIN}"):
            return self.head
        tag = self.tags.get(name.removeprefix("refs/tags/"))
        known = [*self.commits, *self.tags.values()]
        by_id = (one for one in known if len(name) >= 7 and one.id.startswith(name))
        return tag or next(by_id, None)
