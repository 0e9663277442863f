"""What a misspelt name may mean, the same for columns, settings, keys, keywords and folders.

    similar("token_cuont", columns)     ["token_count"]
    did_you_mean(["a", "b"])            " Did you mean a or b?"

The opposite of what was meant is never proposed: it does more harm than no proposal.
"""

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher, get_close_matches

_OPPOSITES = (
    ("min", "max"),
    ("near", "never"),
    ("always", "never"),
    ("include", "exclude"),
    ("included", "excluded"),
    ("since", "until"),
    ("kept", "rejected"),
    ("first", "last"),
    ("start", "end"),
)
_MOST = 3
_AS_SIMILAR = 0.1  # how much less similar than the first another name may be


def similar(name: str, names: Iterable[str], most: int = _MOST, cutoff: float = 0.6) -> list[str]:
    """The most similar names, case aside; none much less similar than the first. Of two opposites
    only the one that a letter of the name tells from the other.
    """
    wanted, by_lower = name.lower(), {known.lower(): known for known in names}
    near = [
        known
        for known in get_close_matches(wanted, by_lower, max(most, _MOST), cutoff)
        if not _are_opposites(wanted, known)
    ]
    near = [
        known
        for known in near
        if all(_is_meant(wanted, known, other) for other in near if _are_opposites(known, other))
    ]
    ratios = {known: SequenceMatcher(None, known, wanted).ratio() for known in near}
    least = max(ratios.values(), default=0.0) - _AS_SIMILAR
    return [by_lower[known] for known, ratio in ratios.items() if ratio > least][:most]


def _are_opposites(name: str, other: str) -> bool:
    words, others = (set(re.split(r"[\W_]+", text)) for text in (name, other))
    return any(
        (first in words and two in others) or (two in words and first in others)
        for first, two in _OPPOSITES
    )


def _is_meant(name: str, known: str, opposite: str) -> bool:
    """Whether letters of a name are in the one and not in its opposite, and none the reverse."""
    letters, own, others = set(name), set(known), set(opposite)
    return bool(letters & (own - others)) and not letters & (others - own)


def did_you_mean(near: Sequence[str]) -> str:
    """ " Did you mean a or b?", to follow a message; "" without names."""
    return f" Did you mean {' or '.join(near)}?" if near else ""
