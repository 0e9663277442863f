"""Which keys are one machine's share of a crawl."""

import hashlib
from collections.abc import Callable

Part = tuple[int, int] | None  # the i-th of n


def share(part: Part) -> Callable[[str], bool]:
    """Whether a key belongs to the part: the same on every machine, and every key to one."""
    if part is None:
        return lambda key: True
    number, count = part

    def mine(key: str) -> bool:
        return (
            int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "big") % count == number - 1
        )

    return mine
