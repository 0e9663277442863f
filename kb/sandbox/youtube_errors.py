"""Error answers of the Data API v3, as Google words them. Each is (status, body)."""

from __future__ import annotations

from typing import Any

Answer = tuple[int, dict[str, Any]]
_HELP = "https://developers.google.com/youtube/v3/getting-started"


def _error(
    code: int,
    message: str,
    domain: str,
    reason: str,
    *,
    status: str = "",
    details: list[Any] | None = None,
    **more: str,
) -> Answer:
    body: dict[str, Any] = {
        "code": code,
        "message": message,
        "errors": [{"message": message, "domain": domain, "reason": reason, **more}],
    }
    if status:
        body["status"] = status
    if details:
        body["details"] = details
    return code, {"error": body}


def _info(reason: str, metadata: dict[str, str]) -> list[Any]:
    return [
        {
            "@type": "type.googleapis.com/google.rpc.ErrorInfo",
            "reason": reason,
            "domain": "googleapis.com",
            "metadata": {"service": "youtube.googleapis.com", **metadata},
        }
    ]


def key_invalid() -> Answer:
    """A key that nobody was given, in the form that was recorded."""
    return _error(400, "Bad Request", "usageLimits", "keyInvalid")


def key_not_valid() -> Answer:
    """The same in the newer form."""
    return _error(
        400,
        "API key not valid. Please pass a valid API key.",
        "global",
        "badRequest",
        status="INVALID_ARGUMENT",
        details=_info("API_KEY_INVALID", {}),
    )


def key_missing() -> Answer:
    """No key at all."""
    return _error(
        403,
        "Method doesn't allow unregistered callers (callers without established identity). Please use API Key or other form of"
        " API consumer identity to call this API.",
        "global",
        "forbidden",
        status="PERMISSION_DENIED",
    )


def search_spent(limit: int = 100) -> Answer:
    """The search bucket's day is over."""
    return _error(
        429,
        f"Quota exceeded for quota metric 'Search Queries' and limit 'Search Queries per day' of service 'youtube.googleapis.com' for"
        f" consumer 'project_number:0'. The limit is {limit}.",
        "global",
        "rateLimitExceeded",
        status="RESOURCE_EXHAUSTED",
        details=_info(
            "RATE_LIMIT_EXCEEDED",
            {
                "consumer": "projects/0",
                "quota_limit": "SearchQueriesPerDayPerProject",
                "quota_limit_value": str(limit),
                "quota_location": "global",
                "quota_metric": "youtube.googleapis.com/search_queries",
                "quota_unit": "1/d/{project}",
            },
        ),
    )


def general_spent() -> Answer:
    """The general bucket's day is over."""
    return _error(
        403,
        f'The request cannot be completed because you have exceeded your <a href="{_HELP}#quota">quota</a>.',
        "youtube.quota",
        "quotaExceeded",
    )


def burst() -> Answer:
    """Too many requests in a short time, the older form."""
    return _error(
        403, "The request was sent too often in a short time.", "usageLimits", "rateLimitExceeded"
    )


def burst_429() -> Answer:
    """Too many requests in a minute, the newer form."""
    return _error(
        429,
        "Quota exceeded for quota metric 'Queries' and limit 'Queries per minute' of service 'youtube.googleapis.com'.",
        "global",
        "rateLimitExceeded",
        status="RESOURCE_EXHAUSTED",
        details=_info(
            "RATE_LIMIT_EXCEEDED",
            {
                "consumer": "projects/0",
                "quota_limit": "defaultPerMinutePerProject",
                "quota_limit_value": "180000",
                "quota_location": "global",
                "quota_metric": "youtube.googleapis.com/default",
                "quota_unit": "1/min/{project}",
            },
        ),
    )


def unavailable() -> Answer:
    """A failure of the service's own."""
    return _error(
        503, "The service is currently unavailable.", "global", "backendError", status="UNAVAILABLE"
    )


def no_playlist() -> Answer:
    """An uploads playlist that does not exist."""
    return _error(
        404,
        "The playlist identified with the request's <code>playlistId</code> parameter cannot be found.",
        "youtube.playlistItem",
        "playlistNotFound",
        location="playlistId",
        locationType="parameter",
    )


def no_filter() -> Answer:
    """A list call that says of what."""
    return _error(
        400,
        "No filter selected. Expected one of: id, playlistId, q",
        "youtube.parameter",
        "missingRequiredParameter",
        location="parameters.",
        locationType="other",
    )


def too_many_ids() -> Answer:
    """More than 50 ids."""
    return _error(
        400,
        "The request specifies an invalid filter parameter.",
        "youtube.parameter",
        "invalidFilters",
        location="parameters.id",
        locationType="other",
    )


def bad_page_token() -> Answer:
    """A page token that was not handed out."""
    return _error(
        400,
        "The request specifies an invalid page token.",
        "youtube.parameter",
        "invalidPageToken",
        location="pageToken",
        locationType="parameter",
    )


def bad_size(value: str) -> Answer:
    """A page size outside 0 to 50."""
    return _error(
        400,
        f"Invalid value '{value}'. Values must be within the range: [0, 50]",
        "global",
        "invalidParameter",
        location="maxResults",
        locationType="parameter",
    )


def bad_part(name: str) -> Answer:
    """A part that the resource doesn't have."""
    return _error(
        400, f"'{name}'", "youtube.part", "unknownPart", location="part", locationType="parameter"
    )


def not_found(path: str) -> Answer:
    """A path that the API doesn't have."""
    return _error(404, f"Method not found: {path}", "global", "notFound", status="NOT_FOUND")
