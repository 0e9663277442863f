"""Makes the answers of the hub: accounts, errors, repositories, trees and ranges of files.

Source: https://huggingface.co/docs/hub/api, and what `huggingface_hub` reads.
"""

import json
import re
from dataclasses import dataclass
from typing import Any

import msgspec
from werkzeug.exceptions import HTTPException, RequestedRangeNotSatisfiable
from werkzeug.wrappers import Request, Response

from kb.sandbox.hub.repository import MAIN, STAMP, Commit, Repository, StoredFile

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
    found = commit.below(folder, recursive=request.args.get("recursive", "").lower() == "true")
    if folder and not found:
        raise HubError(404, f"{folder} does not exist on this revision.", "EntryNotFound")
    expanded = request.args.get("expand", "").lower() == "true"
    entries = [entry(path, file, commit, expanded=expanded) for path, file in found.items()]
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
