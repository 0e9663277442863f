"""Secrets pass no line: literal ones of this run, and whatever looks like one.

Libraries put keys into URLs, URLs into messages, and messages into exceptions; so everything that
is printed or logged goes through `text`, not only what is known to hold a key.
"""

import json
import re
from collections.abc import Iterable
from urllib.parse import quote, quote_plus

from kb.core.terminal import SHORTEST_SECRET

MARK = "***"

_PATTERNS = [
    # query parameters and form fields: key=…, access_token=…
    (
        re.compile(
            r"(?i)\b((?:api_?)?key|access_token|refresh_token|client_secret|password|token)="
            r"[^&\s\"'<>)]+"
        ),
        r"\1=" + MARK,
    ),
    # headers: Authorization: Bearer …, also as a dict's repr
    (
        re.compile(
            r"(?i)(authorization['\"]?\s*[:=]\s*['\"]?(?:bearer|basic|token)\s+)[^\s'\",}]+"
        ),
        r"\1" + MARK,
    ),
    (re.compile(r"(?i)\b(bearer\s+)[A-Za-z0-9._~+/=-]{16,}"), r"\1" + MARK),
    # Google's API keys and tokens of the Hugging Face hub, wherever they stand
    (re.compile(r"AIza[0-9A-Za-z_-]{30,}"), MARK),
    (re.compile(r"\bhf_[0-9A-Za-z]{30,}"), MARK),
    # What signed addresses carry (timed text, streams):
    # who asked, from where, and the leave to read.
    (
        re.compile(
            r"(?i)((?:[?&]|&amp;|\\u0026)(?:signature|l?sig|ip|ei|pot|visitor_?data)=)"
            r"[^&\s\"'<>)\\]+"
        ),
        r"\1" + MARK,
    ),
    # user:password@host
    (re.compile(r"(?<=://)[^/\s:@]+:[^/\s@]+(?=@)"), MARK),
]
_literal: re.Pattern[str] | None = None
_in_json: tuple[bytes, ...] = ()


def know(secrets: Iterable[str]) -> None:
    """Literal secrets of this process, where they have SHORTEST_SECRET characters; also as they
    look inside a URL. Replaces earlier ones.
    """
    global _literal, _in_json
    forms = {
        form
        for secret in secrets
        if len(secret) >= SHORTEST_SECRET
        for form in (secret, quote(secret, safe=""), quote_plus(secret))
    }
    ordered = sorted(forms, key=len, reverse=True)
    _literal = re.compile("|".join(map(re.escape, ordered))) if ordered else None
    # Within JSON text quotes and backslashes are escaped.
    _in_json = tuple(json.dumps(form, ensure_ascii=False)[1:-1].encode() for form in ordered)


def holds_secret(line: bytes) -> bool:
    """Whether JSON text holds a literal secret of this process. Quick."""
    return any(form in line for form in _in_json)


def literal(value: str) -> str:
    """`value` without the literal secrets; nothing that merely looks like one is touched."""
    return value if _literal is None else _literal.sub(MARK, value)


def text(value: str) -> str:
    """`value` without secrets."""
    value = literal(value)
    for pattern, instead in _PATTERNS:
        value = pattern.sub(instead, value)
    return value
