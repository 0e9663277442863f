"""What an error answer of the Data API means. Decided by codes and reasons, never by wording.

Source: https://developers.google.com/youtube/v3/docs/errors
"""

from typing import Any

from kb.core.errors import CredentialRefused, ItemFinal, KbError, Retryable
from kb.net import retry
from kb.youtube.connector import quota

_SPENT = {"quotaExceeded", "dailyLimitExceeded", "dailyLimitExceededUnreg"}
_BURST = {"rateLimitExceeded", "userRateLimitExceeded"}
_KEY = {
    "keyInvalid",
    "keyExpired",
    "accessNotConfigured",
    "ipRefererBlocked",
    "forbidden",
    "authError",
    "required",
    "API_KEY_INVALID",
    "API_KEY_SERVICE_BLOCKED",
    "SERVICE_DISABLED",
}
# Facts about a list or its channel: it can't be read, today or tomorrow. Any other refusal may be
# the service's or our own fault.
FINAL = {
    "not_found",
    "playlistNotFound",
    "playlistItemsNotAccessible",
    "playlistOperationUnsupported",
    "channelNotFound",
    "channelForbidden",
    "channelClosed",
    "channelSuspended",
}


def meaning(status: int, body: Any, bucket: str, after: float | None = None) -> KbError:
    """The error to raise for an error answer: QuotaSpent, CredentialRefused, Blocked,
    ItemFinal or Retryable.

    ItemFinal for the named facts only; a refusal without a reason is no answer of the API, but of
    what stands before it ("automated queries"). `after` is the answer's Retry-After in seconds.
    """
    error = body.get("error") if isinstance(body, dict) else None
    error = error if isinstance(error, dict) else {}
    reasons = {
        str(part.get("reason"))
        for part in (*_parts(error, "errors"), *_parts(error, "details"))
        if part.get("reason")
    }
    limits = [
        str(part.get("metadata", {}).get("quota_limit", ""))
        for part in _parts(error, "details")
        if isinstance(part.get("metadata"), dict)
    ]
    shown = min(reasons) if reasons else f"http_{status}"
    if reasons & _SPENT or (status == 429 and any("PerDay" in name for name in limits)):
        return quota.spent(bucket)
    if status == 429 or reasons & _BURST:
        return Retryable(f"{shown} ({status})", after=after, throttled=True)
    if status >= 500:
        return Retryable(f"HTTP {status} from the YouTube API", after=after)
    if status == 401 or reasons & _KEY:
        return CredentialRefused(
            f"the YouTube API refuses the key ({shown})",
            hint="check YOUTUBE_API_KEY and that the YouTube Data API v3 is enabled for it",
        )
    if facts := sorted(reasons & FINAL):
        return ItemFinal("not_found" if status == 404 else facts[0], str(status))
    if status == 403 and not reasons:
        return retry.blocked(
            "the YouTube API rejects requests (403 without a reason)", after, waited=True
        )
    return Retryable(f"{shown} ({status})", after=after)


def _parts(error: dict[str, Any], name: str) -> list[dict[str, Any]]:
    parts = error.get(name)
    return [part for part in parts if isinstance(part, dict)] if isinstance(parts, list) else []
