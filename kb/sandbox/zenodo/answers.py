"""Makes the answers of the deposit service: depositions, files and errors as Zenodo has them.

Source: https://developers.zenodo.org ("Representation", "Errors").
"""

import hashlib
import json
import re
import uuid
from dataclasses import dataclass, field
from typing import Any

from werkzeug.exceptions import HTTPException
from werkzeug.wrappers import Request, Response

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

    `whole`: required ones must be there.
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
