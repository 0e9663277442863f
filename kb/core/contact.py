"""Contacts that nobody reads: what examples and templates write where an address belongs."""

from __future__ import annotations

import re

from kb.core.profile.base import FILL_IN

# Hosts of RFC 2606 and RFC 6761, which nobody can own.
_HOST = re.compile(
    r"(?:[@/.]|^)(?:example\.(?:com|org|net|edu)|(?:[\w-]+\.)*(?:example|invalid|test|localhost))"
    r"(?![\w.-]*\w)",
    re.IGNORECASE,
)
_NAME = re.compile(r"\b(?:you|your[-_.]?\w+|someone)@", re.IGNORECASE)


def is_placeholder(contact: str) -> bool:
    """Whether it is an example's address (example.org, you@…, FILL-IN, …invalid)."""
    return FILL_IN in contact or bool(_HOST.search(contact) or _NAME.search(contact))
