"""Error answers of the Data API v3, as Google words them. Each is (status, body).

They are written down in data/youtube/errors.json, in the form of recorded answers; `$value` in
them is what the request was wrong about.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from kb.sandbox.json_templates import written

Answer = tuple[int, dict[str, Any]]


def _answer(name: str, value: object = "") -> Answer:
    said = written("youtube/errors.json", name, {"value": str(value)})
    return said["status"], said["response"]


key_invalid = partial(_answer, "key_invalid")  # a key that nobody was given, as it was recorded
key_not_valid = partial(_answer, "key_not_valid")  # the same in the newer form
key_missing = partial(_answer, "key_missing")
general_spent = partial(_answer, "general_spent")  # the general bucket's day is over
burst = partial(_answer, "burst")  # too many requests in a short time, the older form
burst_429 = partial(_answer, "burst_429")  # too many requests in a minute, the newer form
unavailable = partial(_answer, "unavailable")  # a failure of the service's own
no_playlist = partial(_answer, "no_playlist")  # an uploads playlist that does not exist
no_filter = partial(_answer, "no_filter")  # a list call that does not say of what
too_many_ids = partial(_answer, "too_many_ids")  # more than 50 ids
bad_page_token = partial(_answer, "bad_page_token")  # a page token that was not handed out
bad_size = partial(_answer, "bad_size")  # a page size outside 0 to 50
bad_part = partial(_answer, "bad_part")  # a part that the resource doesn't have
not_found = partial(_answer, "not_found")  # a path that the API doesn't have


def search_spent(limit: int = 100) -> Answer:
    """The search bucket's day is over."""
    return _answer("search_spent", limit)
