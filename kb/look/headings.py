"""Names of tables' columns for people."""

from kb.schema import table

_SHOWN_UNITS = {"s", "px", "CSS px", "UTC", "bytes"}
_WORDS = {"id": "ID", "ids": "IDs", "url": "URL", "fps": "FPS", "nsfw": "NSFW", "num": "number of"}


def heading(name: str, column: str) -> str:
    """The column `duration_s` of a table as "Duration (s)": words, and the unit where the words
    do not say it. Raises KeyError for a table or column that no schema declares.
    """
    unit = table(name).column(column).unit
    bare = column.removesuffix("_s").removesuffix("_utc")
    words = [_WORDS.get(word, word) for word in bare.split("_")]
    words[0] = words[0][0].upper() + words[0][1:]
    return " ".join(words) + (f" ({unit})" if unit in _SHOWN_UNITS else "")
