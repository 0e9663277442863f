"""Serves a hub of data sets on loopback, good enough for `huggingface_hub` and `datasets`.

Accounts by token, repositories, preupload, LFS (one request or parts), commits, trees, files with
ranges, tags, squashed histories. Kept in memory. What a token may not see does not exist for it,
and one that may only read is told so, as on the real hub. Xet storage is not served: the client
uploads through LFS, as it does where `hf_xet` is not installed.
Source: https://huggingface.co/docs/hub/api, and the requests of the client itself.
"""

from __future__ import annotations

import base64
import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import unquote_to_bytes

from werkzeug.exceptions import HTTPException
from werkzeug.routing import Map, Rule
from werkzeug.wrappers import Request, Response

from kb.sandbox.world import World
from tests.services.hub.repository import (
    MAIN,
    NAME,
    STAMP,
    Account,
    Commit,
    HubError,
    Repository,
    StoredFile,
    as_json,
    bytes_of,
    entry,
    git_blob,
    info,
    is_lfs,
    json_body,
    lfs_object,
    refs,
    tree,
)

TOKEN, READER, STRANGER = "hf_sandboxwrite0001", "hf_sandboxread00001", "hf_sandboxother0001"
ORGANISATION = "sandbox-lab"
ACCOUNTS = {
    TOKEN: Account("sandbox", (ORGANISATION,), writes=True),
    READER: Account("sandbox", (ORGANISATION,), writes=False),
    STRANGER: Account("stranger", (), writes=True),
}
_SLASH = "\x01"  # an escaped "/" on its way through the routes
PART = 5 * 2**20  # bytes of a part; a larger object is uploaded in parts


def settings(url: str) -> dict[str, str]:
    """The settings that point at this service; the last keeps clients from asking for Xet."""
    return {"HF_ENDPOINT": url, "HF_TOKEN": TOKEN, "HF_HUB_DISABLE_XET": "1"}


def app(world: World) -> HubService:
    """The WSGI application, which holds what was uploaded."""
    return HubService()


class HubService:
    """The service: a WSGI callable with its data sets in `repositories`."""

    def __init__(self) -> None:
        self.repositories: dict[str, Repository] = {}
        self.part = PART
        self._parts: dict[str, dict[int, bytes]] = {}
        self._lock = threading.RLock()
        data_set = "/api/datasets/<owner>/<name>"
        lfs = "/datasets/<owner>/<name>.git/info/lfs"
        routes: list[tuple[str, str, Callable[..., Response]]] = [
            ("GET", "/api/whoami-v2", self._whoami),
            ("POST", "/api/validate-yaml", self._validate),
            ("POST", "/api/repos/create", self._create),
            ("GET", data_set, self._info),
            ("GET", f"{data_set}/revision/<path:revision>", self._info),
            ("GET", f"{data_set}/refs", self._refs),
            ("GET", f"{data_set}/commits/<revision>", self._commits),
            ("GET", f"{data_set}/tree/<revision>", self._tree),
            ("GET", f"{data_set}/tree/<revision>/<path:folder>", self._tree),
            ("POST", f"{data_set}/paths-info/<revision>", self._paths),
            ("POST", f"{data_set}/preupload/<revision>", self._preupload),
            ("POST", f"{data_set}/commit/<revision>", self._commit),
            ("POST", f"{data_set}/tag/<revision>", self._tag),
            ("DELETE", f"{data_set}/tag/<revision>", self._untag),
            ("POST", f"{data_set}/super-squash/<revision>", self._squash),
            ("GET", f"{data_set}/lfs-files", self._objects),
            ("POST", f"{data_set}/lfs-files/batch", self._delete_objects),
            ("POST", f"{lfs}/objects/batch", self._batch),
            ("PUT", f"{lfs}/objects/<oid>", self._put),
            ("PUT", f"{lfs}/objects/<oid>/<int:part>", self._put_part),
            ("POST", f"{lfs}/objects/<oid>/complete", self._complete),
            ("POST", f"{lfs}/verify", self._verify),
            ("GET", "/datasets/<owner>/<name>/resolve/<revision>/<path:path>", self._resolve),
        ]
        self._routes = Map(
            [Rule(rule, endpoint=handler, methods=[method]) for method, rule, handler in routes],
            merge_slashes=False,
        )

    def __call__(self, environ: Any, start_response: Any) -> Any:
        # A revision may hold "/", which the client escapes: routes see it still escaped.
        environ = dict(environ)
        raw = environ.get("RAW_URI", environ["PATH_INFO"]).partition("?")[0]
        marked = raw.replace("%2F", _SLASH).replace("%2f", _SLASH)
        environ["PATH_INFO"] = unquote_to_bytes(marked).decode("latin-1")  # as WSGI writes paths
        request = Request(environ)
        try:
            handler, values = self._routes.bind_to_environ(environ).match()
            with self._lock:
                values = {
                    name: what.replace(_SLASH, "/") if isinstance(what, str) else what
                    for name, what in values.items()
                }
                response = handler(request, **values)
        except HubError as error:
            response = error.get_response()
        except HTTPException as error:
            response = HubError(error.code or 500, error.description or "").get_response()
        if request.method in ("PUT", "POST"):
            request.get_data(cache=False)  # an unread body would break the connection
        return response(environ, start_response)

    # -- accounts and repositories -----------------------------------------------------------------

    def _account(self, request: Request) -> Account | None:
        """Whose token it is; None without one. A signed upload address stands for its maker."""
        token = request.headers.get("Authorization", "").removeprefix("Bearer ")
        if token and token not in ACCOUNTS:
            raise HubError(401, "Invalid credentials in Authorization header")
        return ACCOUNTS.get(token)

    def _whoami(self, request: Request) -> Response:
        account = self._account(request)
        if account is None:
            raise HubError(401, "Invalid username or password.")
        return as_json(account.shown())

    def _validate(self, request: Request) -> Response:
        content = json_body(request).get("content", "")
        errors = [] if str(content).startswith("---\n") else [{"message": "no metadata"}]
        return as_json({"errors": errors, "warnings": []}, 400 if errors else 200)

    def _create(self, request: Request) -> Response:
        account, body = self._account(request), json_body(request)
        if account is None:
            raise HubError(401, "Invalid username or password.")
        owner, name = body.get("organization") or account.name, str(body.get("name", ""))
        full = f"{owner}/{name}"
        if not NAME.fullmatch(name) or name.endswith(".git"):
            raise HubError(400, f"Invalid repository name {name}")
        if not account.may_write(owner):
            what = f'You don\'t have the rights to create a dataset under the namespace "{owner}"'
            raise HubError(403, what)
        if full in self.repositories:
            raise HubError(409, "You already created this dataset repo")
        private = body.get("visibility") == "private" or bool(body.get("private"))
        self.repositories[full] = Repository(full, private=private, author=account.name)
        url = f"{request.host_url}datasets/{full}"
        return as_json({"url": url, "name": full, "id": full})

    def _find(self, request: Request, owner: str, name: str, *, write: bool = False) -> Repository:
        """The repository. What an account may not see does not exist for it."""
        account, one = self._account(request), self.repositories.get(f"{owner}/{name}")
        mine = account is not None and owner in (account.name, *account.organisations)
        if one is None or (one.private and not mine):
            known = account is not None
            what = "Repository not found" if known else "Invalid username or password."
            raise HubError(404 if known else 401, what, "RepoNotFound")
        if write and (account is None or not account.may_write(owner)):
            what = "you must have write access" if account else "you must be logged in"
            raise HubError(403, f"You don't have permission: {what} to {one.name}")
        return one

    def _at(self, one: Repository, revision: str) -> Commit:
        commit = one.revision(revision)
        if commit is None:
            raise HubError(404, f"Invalid rev id: {revision}", "RevisionNotFound")
        return commit

    def _info(self, request: Request, owner: str, name: str, revision: str = MAIN) -> Response:
        one = self._find(request, owner, name)
        return as_json(info(one, self._at(one, revision)))

    def _refs(self, request: Request, owner: str, name: str) -> Response:
        return as_json(refs(self._find(request, owner, name)))

    def _commits(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name)
        commits = one.commits if revision == MAIN else [self._at(one, revision)]
        return as_json([commit.shown() for commit in reversed(commits)])

    def _tree(
        self, request: Request, owner: str, name: str, revision: str, folder: str = ""
    ) -> Response:
        one = self._find(request, owner, name)
        return tree(self._at(one, revision), folder.strip("/"), request)

    def _paths(self, request: Request, owner: str, name: str, revision: str) -> Response:
        commit = self._at(self._find(request, owner, name), revision)
        if request.mimetype == "application/json":
            body = json_body(request)
            paths, expanded = body.get("paths", []), bool(body.get("expand"))
        else:
            paths = request.form.getlist("paths")
            expanded = request.form.get("expand", "").lower() == "true"
        known = commit.below("", recursive=True)
        there = [path.strip("/") for path in paths if path.strip("/") in known]
        return as_json([entry(path, known[path], commit, expanded=expanded) for path in there])

    # -- uploads -----------------------------------------------------------------------------------

    def _preupload(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name, write=True)
        there = self._at(one, revision).files
        files = []
        for file in json_body(request).get("files", []):
            path, sample = str(file["path"]), base64.b64decode(file.get("sample", ""))
            known = there.get(path)
            files.append(
                {
                    "path": path,
                    "uploadMode": "lfs" if is_lfs(path, sample, int(file["size"])) else "regular",
                    "shouldIgnore": False,
                    "oid": known.etag if known else None,
                }
            )
        return as_json({"files": files})

    def _batch(self, request: Request, owner: str, name: str) -> Response:
        one = self._find(request, owner, name, write=True)
        base = f"{request.host_url}datasets/{one.name}.git/info/lfs"
        objects: list[dict[str, Any]] = []
        for wanted in json_body(request).get("objects", []):
            oid, size = str(wanted["oid"]), int(wanted["size"])
            shown: dict[str, Any] = {"oid": oid, "size": size}
            if oid not in one.objects:
                parts = range(1, -(-size // self.part) + 1) if size > self.part else ()
                place = f"{base}/objects/{oid}"
                header = {f"{part:05d}": f"{place}/{part}" for part in parts}
                header |= {"chunk_size": str(self.part)} if parts else {}
                upload = {"href": f"{place}/complete" if parts else place, "header": header}
                shown["actions"] = {"upload": upload, "verify": {"href": f"{base}/verify"}}
            objects.append(shown)
        return as_json({"transfer": "basic", "objects": objects})

    def _put(self, request: Request, owner: str, name: str, oid: str) -> Response:
        """Bytes at the address that the batch gave: it stands for itself, as a signed one does."""
        return self._stored(owner, name, oid, _body(request))

    def _put_part(self, request: Request, owner: str, name: str, oid: str, part: int) -> Response:
        data = _body(request)
        self._parts.setdefault(f"{owner}/{name}/{oid}", {})[part] = data
        return Response(headers={"ETag": f'"{hashlib.md5(data).hexdigest()}"'})

    def _complete(self, request: Request, owner: str, name: str, oid: str) -> Response:
        parts = self._parts.pop(f"{owner}/{name}/{oid}", {})
        return self._stored(owner, name, oid, b"".join(parts[number] for number in sorted(parts)))

    def _stored(self, owner: str, name: str, oid: str, data: bytes) -> Response:
        if hashlib.sha256(data).hexdigest() != oid:
            raise HubError(400, "The bytes do not have this SHA-256.")
        self.repositories[f"{owner}/{name}"].objects[oid] = data
        return as_json({})

    def _verify(self, request: Request, owner: str, name: str) -> Response:
        one, body = self._find(request, owner, name, write=True), json_body(request)
        data = one.objects.get(str(body.get("oid")))
        if data is None or len(data) != body.get("size"):
            raise HubError(404, "The object is not there.")
        return as_json({})

    # -- revisions ---------------------------------------------------------------------------------

    def _commit(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name, write=True)
        author = self._name_of(request)
        if revision != MAIN:
            raise HubError(400, f"{revision} is no branch.")
        header: dict[str, Any] = {}
        files = dict(one.head.files)
        for key, value in _operations(request):
            if key == "header":
                header = value
            else:
                _apply(one, files, key, value)
        parent = header.get("parentCommit")
        if parent and parent != one.head.id:
            raise HubError(412, "A commit has happened since. Please refresh and try again.")
        title, message = str(header.get("summary", "")), str(header.get("description", ""))
        commit = one.commit(files, title, message, author)
        url = f"{request.host_url}datasets/{one.name}/commit/{commit.id}"
        return as_json({"success": True, "commitOid": commit.id, "commitUrl": url})

    def _name_of(self, request: Request) -> str:
        account = self._account(request)
        return account.name if account else ""

    def _tag(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name, write=True)
        tag, commit = str(json_body(request).get("tag", "")), self._at(one, revision)
        if tag in one.tags:
            raise HubError(409, f"Tag {tag} already exists")
        one.tags[tag] = commit
        return as_json({})

    def _untag(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name, write=True)
        if one.tags.pop(revision, None) is None:
            raise HubError(404, f"There is no tag {revision}", "RevisionNotFound")
        return as_json({})

    def _squash(self, request: Request, owner: str, name: str, revision: str) -> Response:
        one = self._find(request, owner, name, write=True)
        if revision != MAIN:
            raise HubError(404, f"Invalid rev id: {revision}", "RevisionNotFound")
        one.squash(str(json_body(request).get("message", "")), self._name_of(request))
        return as_json({})

    def _objects(self, request: Request, owner: str, name: str) -> Response:
        """Every LFS object that is stored, whether a revision names it or not."""
        one = self._find(request, owner, name, write=True)
        shown = [
            {
                "fileOid": oid,
                "oid": oid,
                "filename": "",
                "pushedAt": STAMP,
                "ref": None,
                "size": len(data),
            }
            for oid, data in one.objects.items()
        ]
        return as_json(shown)

    def _delete_objects(self, request: Request, owner: str, name: str) -> Response:
        one = self._find(request, owner, name, write=True)
        for oid in json_body(request).get("deletions", {}).get("sha", []):
            one.objects.pop(str(oid), None)
        return as_json({})

    def _resolve(
        self, request: Request, owner: str, name: str, revision: str, path: str
    ) -> Response:
        one = self._find(request, owner, name)
        commit = self._at(one, revision)
        file = commit.files.get(path)
        if file is None:
            raise HubError(404, "Entry not found", "EntryNotFound")
        return bytes_of(file, commit, request)


def _operations(request: Request) -> Iterator[tuple[str, dict[str, Any]]]:
    """The lines of a commit. Raises HubError."""
    try:
        lines = [json.loads(line) for line in request.get_data().splitlines() if line.strip()]
        yield from [(str(one["key"]), dict(one["value"])) for one in lines]
    except (ValueError, TypeError, KeyError):
        raise HubError(400, "The commit is no NDJSON of operations.") from None


def _apply(one: Repository, files: dict[str, StoredFile], key: str, value: dict[str, Any]) -> None:
    """One operation of a commit on its tree."""
    path = str(value.get("path", "")).strip("/")
    if key == "file":
        files[path] = git_blob(base64.b64decode(value["content"]))
    elif key == "lfsFile":
        if value["oid"] not in one.objects:
            raise HubError(400, f"The LFS object of {path} was not uploaded.")
        files[path] = lfs_object(one.objects[value["oid"]])
    elif key == "deletedFile":
        if files.pop(path, None) is None:
            raise HubError(404, "A file with this name doesn't exist", "EntryNotFound")
    elif key == "deletedFolder":
        for inner in [name for name in files if name.startswith(f"{path}/")]:
            del files[inner]
    else:
        raise HubError(400, f"Unknown operation {key}")


def _body(request: Request) -> bytes:
    """The body. Raises HubError where it was cut off."""
    data = request.get_data(cache=False)
    if request.content_length is not None and len(data) != request.content_length:
        raise HubError(400, "The request body was cut off.")
    return data
