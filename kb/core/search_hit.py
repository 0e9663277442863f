"""An answer of a search, whatever was searched."""

import msgspec


class SearchHit(msgspec.Struct):
    """A passage that was asked for. `text` is at most as long as was asked, `snippet` a part of it
    with the words marked (of the title where the passage has no text of its own); `start_s` where
    a video speaks of it; `licence` None where the source gives none.
    """

    text: str
    snippet: str
    source: str
    kind: str
    key: str
    title: str
    path: str
    score: float
    url: str
    licence: str | None
    date: str | None
    start_s: float | None = None


def cut(text: str, size: int) -> str:
    """The text, or as much of it as `size` characters hold with an ellipsis."""
    return text if len(text) <= size else text[: max(0, size - 1)].rstrip() + "…"
