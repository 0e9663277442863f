"""Serves the deposit API of Zenodo as documented, errors included.

Depositions, the file bucket, publish, new versions, public records and their files. Kept in memory.
It also behaves as the real service does where its page is silent: a deposit without a licence
becomes CC0, a second draft of a record that still has files is refused, file names are flat.
Source: https://developers.zenodo.org ("Depositions", "Deposition files", "Deposition actions",
"Errors").
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import threading
import uuid
from dataclasses import dataclass, field
from typing import Any

from werkzeug.exceptions import BadRequest, HTTPException
from werkzeug.routing import Map, Rule
from werkzeug.wrappers import Request, Response

from kb.sandbox.world import World

TYPES = {
    "dataset",
    "software",
    "publication",
    "image",
    "video",
    "poster",
    "presentation",
    "lesson",
    "physicalobject",
    "other",
}
LICENCES = re.compile(
    r"(cc-by(-nc)?(-sa|-nd)?-[1-4]\.0|cc0-1\.0|cc-zero|mit|apache-2\.0|other-open)(-[a-z]{2})?"
)
STAMP = "2026-11-20T12:00:00.000000+00:00"


class ZenodoError(HTTPException):
    """An error in the API's own form."""

    def __init__(
        self,
        status: int,
        message: str,
        errors: list[dict[str, Any]] | None = None,
    ) -> None:
        body = {"status": status, "message": message} | ({"errors": errors} if errors else {})
        super().__init__(response=Response(json.dumps(body), status, mimetype="application/json"))
        self.code = status


def refused(message: str, field: str, why: str) -> ZenodoError:
    """400, with what is wrong at one field."""
    return ZenodoError(400, message, [{"field": field, "message": why}])


@dataclass
class Deposition:
    """One deposition: a draft, or a published record."""

    id: int
    concept: int
    bucket: str
    metadata: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    submitted: bool = False


def shown(one: Deposition, draft: Deposition | None, request: Request) -> dict[str, Any]:
    """A deposition; `draft`: the open one of its record, if there is one."""
    own = f"{root_of(request)}/api/deposit/depositions/{one.id}"
    links = {
        "self": own,
        "html": f"{root_of(request)}/deposit/{one.id}",
        "bucket": f"{root_of(request)}/api/files/{one.bucket}",
        "files": f"{own}/files",
    }
    links |= {
        action: f"{own}/actions/{action}" for action in ("publish", "edit", "discard", "newversion")
    }
    if draft is not None:
        links["latest_draft"] = f"{root_of(request)}/api/deposit/depositions/{draft.id}"
    body = {
        "id": one.id,
        "conceptrecid": str(one.concept),
        "created": STAMP,
        "modified": STAMP,
        "owner": 1,
        "record_id": one.id,
        "state": "done" if one.submitted else "unsubmitted",
        "submitted": one.submitted,
        "title": one.metadata.get("title", ""),
        "metadata": {
            **one.metadata,
            "prereserve_doi": {"doi": f"10.5072/zenodo.{one.id}", "recid": one.id},
        },
        "files": [file_entry(one, name) for name in one.files],
        "links": links,
    }
    return body | (
        {"doi": one.metadata["doi"], "conceptdoi": f"10.5072/zenodo.{one.concept}"}
        if one.submitted
        else {}
    )


def checked_metadata(given: dict[str, Any], *, complete: bool) -> dict[str, Any]:
    """The metadata as the service keeps it; 400 with every wrong field.

    `complete`: required ones must be there.
    """
    errors = []
    if complete:
        errors = [
            {"field": f"metadata.{name}", "message": "Missing data for required field."}
            for name in ("title", "upload_type", "description", "creators")
            if not given.get(name)
        ]
    if given.get("upload_type") and given["upload_type"] not in TYPES:
        errors.append({"field": "metadata.upload_type", "message": "Not a valid choice."})
    if given.get("license") and not LICENCES.fullmatch(str(given["license"])):
        errors.append(
            {
                "field": "metadata.license",
                "message": f"Invalid license provided: {given['license']}",
            }
        )
    if given.get("publication_date") and not re.fullmatch(
        r"\d{4}-\d{2}-\d{2}", str(given["publication_date"])
    ):
        errors.append({"field": "metadata.publication_date", "message": "Not a valid date."})
    if errors:
        raise ZenodoError(400, "Validation error.", errors)
    kept = dict(given)
    if given.get("access_right", "open") in ("open", "embargoed"):
        kept.setdefault("access_right", "open")
        kept.setdefault("license", "cc-zero")  # the real service's silent default
    return kept


def file_entry(one: Deposition, name: str) -> dict[str, Any]:
    """A file of a deposition; its id changes with its bytes."""
    data = one.files[name]
    digest = hashlib.md5(data).hexdigest()
    return {
        "id": str(uuid.uuid5(uuid.NAMESPACE_URL, f"{one.id}/{name}/{digest}")),
        "filename": name,
        "filesize": len(data),
        "checksum": digest,
    }


def file_stored(one: Deposition, name: str, request: Request) -> dict[str, Any]:
    """A file as its bucket tells it."""
    entry = file_entry(one, name)
    return {
        "key": name,
        "mimetype": "application/octet-stream",
        "size": entry["filesize"],
        "checksum": f"md5:{entry['checksum']}",
        "version_id": entry["id"],
        "is_head": True,
        "created": STAMP,
        "updated": STAMP,
        "links": {"self": f"{root_of(request)}/api/files/{one.bucket}/{name}"},
    }


def record(one: Deposition, request: Request) -> dict[str, Any]:
    """A published record, as anybody may see it."""
    place = f"{root_of(request)}/api/records/{one.id}"
    files = [
        {
            "key": name,
            "size": len(data),
            "checksum": f"md5:{file_entry(one, name)['checksum']}",
            "links": {"self": f"{place}/files/{name}/content"},
        }
        for name, data in one.files.items()
    ]
    return {
        "id": one.id,
        "conceptrecid": str(one.concept),
        "doi": one.metadata["doi"],
        "metadata": one.metadata,
        "files": files,
    }


def json_body(request: Request) -> dict[str, Any]:
    if request.mimetype != "application/json":
        raise ZenodoError(415, "Unsupported media type. Content-Type must be application/json.")
    try:
        body = json.loads(request.get_data() or b"{}")
    except ValueError:
        raise ZenodoError(400, "Unable to decode JSON data in request body.") from None
    if not isinstance(body, dict):
        raise ZenodoError(400, "The body must be a JSON object.")
    return body


def as_json(body: Any, status: int = 200) -> Response:
    headers = {"X-RateLimit-Limit": "100", "X-RateLimit-Remaining": "99"}
    return Response(json.dumps(body), status, headers, mimetype="application/json")


def root_of(request: Request) -> str:
    """Where the service was asked."""
    return request.host_url.rstrip("/")


TOKEN = "sandbox-deposit-token"
_UNAUTHORIZED = (
    "The server could not verify that you are authorized to access the URL requested."
    " You either supplied the wrong credentials (e.g. a bad password),"
    " or your browser doesn't understand how to supply"
    " the credentials required."
)


def settings(url: str) -> dict[str, str]:
    """The settings that point at this service."""
    return {"KB_ZENODO_ENDPOINT": url, "ZENODO_TOKEN": TOKEN}


def app(world: World) -> Deposits:
    """The WSGI application, which holds what was uploaded."""
    return Deposits()


class Deposits:
    """The service: a WSGI callable with its deposits in `by_id`."""

    def __init__(self) -> None:
        self.by_id: dict[int, Deposition] = {}
        self._numbers = itertools.count(100_001)
        self._lock = threading.RLock()
        base = "/api/deposit/depositions"
        self._routes = Map(
            [
                Rule(base, endpoint=self._list, methods=["GET"]),
                Rule(base, endpoint=self._create, methods=["POST"]),
                Rule(f"{base}/<int:number>", endpoint=self._get, methods=["GET"]),
                Rule(f"{base}/<int:number>", endpoint=self._update, methods=["PUT"]),
                Rule(f"{base}/<int:number>/files", endpoint=self._files, methods=["GET"]),
                Rule(
                    f"{base}/<int:number>/files/<file>", endpoint=self._remove, methods=["DELETE"]
                ),
                Rule(
                    f"{base}/<int:number>/actions/publish", endpoint=self._publish, methods=["POST"]
                ),
                Rule(
                    f"{base}/<int:number>/actions/newversion",
                    endpoint=self._new_version,
                    methods=["POST"],
                ),
                Rule("/api/files/<bucket>/<path:name>", endpoint=self._put, methods=["PUT"]),
                Rule("/api/records/<int:number>", endpoint=self._record, methods=["GET"]),
                Rule(
                    "/api/records/<int:number>/files/<path:name>/content",
                    endpoint=self._content,
                    methods=["GET"],
                ),
            ],
            strict_slashes=False,
        )

    def __call__(self, environ: Any, start_response: Any) -> Any:
        request = Request(environ)
        try:
            handler, values = self._routes.bind_to_environ(environ).match()
            with self._lock:
                public = handler in (self._record, self._content)
                if not public:
                    self._authorize(request)
                response = handler(request, **values)
        except ZenodoError as error:
            response = error.get_response()
        except HTTPException as error:
            response = ZenodoError(error.code or 500, error.description or "").get_response()
        if request.method in ("PUT", "POST"):
            request.get_data(
                cache=False
            )  # an answer before the body was read would break the connection
        return response(environ, start_response)

    # -- depositions -----------------------------------------------------------------------------

    def _authorize(self, request: Request) -> None:
        given = request.headers.get("Authorization", "").removeprefix(
            "Bearer "
        ) or request.args.get("access_token", "")
        if not given:
            raise ZenodoError(401, _UNAUTHORIZED)
        if given != TOKEN:
            raise ZenodoError(403, "Invalid access token.")

    def _list(self, request: Request) -> Response:
        status = request.args.get("status")
        wanted = [
            one
            for one in self.by_id.values()
            if status is None or one.submitted == (status == "published")
        ]
        newest = wanted[::-1][: request.args.get("size", 10, int)]
        return as_json([self._shown(one, request) for one in newest])

    def _create(self, request: Request) -> Response:
        metadata = checked_metadata(json_body(request).get("metadata", {}), complete=False)
        made = self._new()
        made.metadata = metadata
        next(self._numbers)
        return as_json(self._shown(made, request), 201)

    def _new(self, concept: int | None = None) -> Deposition:
        number = next(self._numbers)
        bucket = str(uuid.uuid5(uuid.NAMESPACE_URL, str(number)))
        self.by_id[number] = Deposition(number, concept or number - 1, bucket)
        return self.by_id[number]

    def _find(self, number: int) -> Deposition:
        if number not in self.by_id:
            raise ZenodoError(404, "PID does not exist.")
        return self.by_id[number]

    def _draft(self, number: int) -> Deposition:
        deposit = self._find(number)
        if deposit.submitted:
            raise refused("Invalid action", "state", "The deposition is published.")
        return deposit

    def _get(self, request: Request, number: int) -> Response:
        return as_json(self._shown(self._find(number), request))

    def _update(self, request: Request, number: int) -> Response:
        deposit, body = self._draft(number), json_body(request)
        if "metadata" not in body:
            raise refused("Validation error.", "metadata", "Missing data for required field.")
        deposit.metadata = checked_metadata(body["metadata"], complete=False)
        return as_json(self._shown(deposit, request))

    # -- files -----------------------------------------------------------------------------------

    def _files(self, request: Request, number: int) -> Response:
        return as_json([file_entry(self._find(number), name) for name in self._find(number).files])

    def _remove(self, request: Request, number: int, file: str) -> Response:
        deposit = self._draft(number)
        name = next(
            (name for name in deposit.files if file_entry(deposit, name)["id"] == file), None
        )
        if name is None:
            raise ZenodoError(404, "File not found.")
        del deposit.files[name]
        return Response(status=204)

    def _put(self, request: Request, bucket: str, name: str) -> Response:
        deposit = next((one for one in self.by_id.values() if one.bucket == bucket), None)
        if deposit is None:
            raise ZenodoError(404, "Bucket does not exist.")
        if deposit.submitted:
            raise ZenodoError(403, "Bucket is locked for modifications.")
        if "/" in name:
            raise ZenodoError(400, "Invalid key: file names are flat.")
        data = request.get_data(cache=False)
        if request.content_length is not None and len(data) != request.content_length:
            raise BadRequest("The request body was cut off.")
        deposit.files[name] = data
        return as_json(file_stored(deposit, name, request), 201)

    # -- actions and records -----------------------------------------------------------------------

    def _publish(self, request: Request, number: int) -> Response:
        deposit = self._draft(number)
        deposit.metadata = checked_metadata(deposit.metadata, complete=True)
        if not deposit.files:
            raise refused("Validation error.", "files", "Minimum one file must be provided.")
        deposit.submitted = True
        deposit.metadata["doi"] = f"10.5072/zenodo.{deposit.id}"
        return as_json(self._shown(deposit, request), 202)

    def _new_version(self, request: Request, number: int) -> Response:
        deposit = self._find(number)
        if not deposit.submitted:
            raise refused("Invalid action", "state", "The deposition is not published.")
        draft = self._open_draft(deposit)
        if draft is not None and draft.files:
            raise ZenodoError(
                400,
                "A validation error occurred.",
                [{"field": "files.enabled", "messages": ["Please remove all files first."]}],
            )
        if draft is None:
            draft = self._new(deposit.concept)
            own = ("doi", "publication_date", "version")  # each version has its own
            draft.metadata = {k: v for k, v in deposit.metadata.items() if k not in own}
            draft.files = dict(deposit.files)
        return as_json(self._shown(deposit, request), 201)

    def _open_draft(self, deposit: Deposition) -> Deposition | None:
        return next(
            (
                one
                for one in self.by_id.values()
                if one.concept == deposit.concept and not one.submitted
            ),
            None,
        )

    def _record(self, request: Request, number: int) -> Response:
        deposit = self._find(number)
        if not deposit.submitted:
            raise ZenodoError(404, "PID does not exist.")
        return as_json(record(deposit, request))

    def _content(self, request: Request, number: int, name: str) -> Response:
        deposit = self._find(number)
        if not deposit.submitted or name not in deposit.files:
            raise ZenodoError(404, "File not found.")
        return Response(deposit.files[name], mimetype="application/octet-stream")

    def _shown(self, one: Deposition, request: Request) -> dict[str, Any]:
        return shown(one, self._open_draft(one), request)
