"""A data set repository of the hub: commits of whole trees, one branch, tags.

Bytes are kept in memory, by digest. A file is an LFS object when it is binary or large, else a git
blob; a tree names both by the digests that git and LFS give them.
"""

import hashlib
import json
import re
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

import msgspec
from werkzeug.exceptions import HTTPException, RequestedRangeNotSatisfiable
from werkzeug.wrappers import Request, Response

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
        there: dict[str, StoredFile | None] = {}
        for path, file in sorted(self.files.items()):
            if not path.startswith(start):
                continue
            inner = path[len(start) :].split("/")
            depths = range(1, len(inner)) if recursive else range(1, min(2, len(inner)))
            for depth in depths:
                there[start + "/".join(inner[:depth])] = None
            if recursive or len(inner) == 1:
                there[path] = file
        return there


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


TREE_PAGE = 1_000  # entries of a page
NAME = re.compile(r"(?=.{1,96}$)(?!.*(--|\.\.))[A-Za-z0-9][\w.-]*(?<![.-])")


class HubError(HTTPException):
    """An error in the hub's own form: `code` is its name for it, where it has one."""

    def __init__(self, status: int, message: str, code: str = "") -> None:
        headers = {"X-Error-Message": message} | ({"X-Error-Code": code} if code else {})
        body = json.dumps({"error": message})
        super().__init__(response=Response(body, status, headers, mimetype="application/json"))
        self.code = status


@dataclass(frozen=True)
class Account:
    """Who a token stands for, and what it may do."""

    name: str
    organisations: tuple[str, ...]
    writes: bool

    def may_write(self, namespace: str) -> bool:
        """Whether repositories of this namespace are its own."""
        return self.writes and namespace in (self.name, *self.organisations)

    def shown(self) -> dict[str, Any]:
        """The answer of whoami-v2."""
        return {
            "type": "user",
            "id": "000000000000000000000001",
            "name": self.name,
            "fullname": self.name,
            "orgs": [{"type": "org", "name": one} for one in self.organisations],
            "auth": {
                "type": "access_token",
                "accessToken": {
                    "displayName": "sandbox",
                    "role": "write" if self.writes else "read",
                },
            },
        }


def info(one: Repository, commit: Commit) -> dict[str, Any]:
    """What the hub says of a data set at a revision."""
    return {
        "_id": "000000000000000000000002",
        "id": one.name,
        "author": one.name.partition("/")[0],
        "sha": commit.id,
        "private": one.private,
        "gated": False,
        "disabled": False,
        "downloads": 0,
        "likes": 0,
        "tags": [],
        "createdAt": STAMP,
        "lastModified": STAMP,
        "siblings": [
            {"rfilename": path, "size": file.size, "blobId": file.oid}
            for path, file in sorted(commit.files.items())
        ],
    }


def refs(one: Repository) -> dict[str, Any]:
    """Branches and tags."""
    return {
        "branches": [{"name": MAIN, "ref": f"refs/heads/{MAIN}", "targetCommit": one.head.id}],
        "converts": [],
        "tags": [
            {"name": name, "ref": f"refs/tags/{name}", "targetCommit": commit.id}
            for name, commit in one.tags.items()
        ],
    }


def tree(commit: Commit, folder: str, request: Request) -> Response:
    """A page of a folder, with a link to the next one."""
    there = commit.below(folder, recursive=request.args.get("recursive", "").lower() == "true")
    if folder and not there:
        raise HubError(404, f"{folder} does not exist on this revision.", "EntryNotFound")
    expanded = request.args.get("expand", "").lower() == "true"
    entries = [entry(path, file, commit, expanded=expanded) for path, file in there.items()]
    size = request.args.get("limit", TREE_PAGE, int)
    start = request.args.get("cursor", 0, int)
    answer = as_json(entries[start : start + size])
    if start + size < len(entries):
        query = {**request.args, "cursor": str(start + size)}
        words = "&".join(f"{name}={what}" for name, what in query.items())
        answer.headers["Link"] = f'<{request.base_url}?{words}>; rel="next"'
    return answer


def entry(path: str, file: StoredFile | None, commit: Commit, *, expanded: bool) -> dict[str, Any]:
    """A file or folder of a tree."""
    if file is not None:
        return file.shown(path, commit=commit if expanded else None)
    short = {"type": "directory", "path": path, "size": 0, "oid": commit.id}
    return short | ({"lastCommit": commit.shown_short()} if expanded else {})


def bytes_of(file: StoredFile, commit: Commit, request: Request) -> Response:
    """A file, or the range of it that was asked for, with the headers that the client reads."""
    headers = {
        "ETag": f'"{file.etag}"',
        "X-Repo-Commit": commit.id,
        "Accept-Ranges": "bytes",
        "Cache-Control": "no-cache",
    }
    if file.sha256:
        headers |= {"X-Linked-Etag": f'"{file.sha256}"', "X-Linked-Size": str(file.size)}
    answer = Response(file.data, headers=headers, mimetype="application/octet-stream")
    if request.range is not None and file.size:
        try:
            answer.make_conditional(request.environ, accept_ranges=True, complete_length=file.size)
        except RequestedRangeNotSatisfiable:
            raise HubError(416, "The range is not satisfiable.") from None
    elif request.range is not None:
        raise HubError(416, "The range is not satisfiable.")
    return answer


def json_body(request: Request, shape: Any = dict[str, Any]) -> Any:
    """What was sent, of this shape. Raises HubError."""
    try:
        return msgspec.convert(json.loads(request.get_data() or b"{}"), shape)
    except ValueError as error:  # msgspec's is one too
        raise HubError(400, f"Invalid body: {error}") from None


def as_json(body: Any, status: int = 200) -> Response:
    return Response(json.dumps(body), status, mimetype="application/json")
