"""Names of tables' columns and of their values for people."""

from kb.schema import table

_SHOWN_UNITS = {"s", "px", "CSS px", "UTC", "bytes"}
_CAPITALS = {"id": "ID", "ids": "IDs", "url": "URL", "fps": "FPS", "nsfw": "NSFW"}
# What the unit says as well.
_ENDINGS = {"s": ("_s",), "UTC": ("_utc", "_at", "_timestamp")}


def heading(name: str, column: str) -> str:
    """The column `duration_s` of a table as "Duration (s)", `view_count` as "Views": words, and the
    unit where the words do not say it. Raises UsageError for an unknown table, SchemaMismatch for
    an unknown column.
    """
    unit = table(name).column(column).unit
    if unit and column in (f"{unit[:-1]}_count", f"num_{unit}"):
        return unit.capitalize()
    for ending in _ENDINGS.get(unit, ()):
        column = column.removesuffix(ending)
    words = [_CAPITALS.get(word, word) for word in column.split("_")]
    words[0] = words[0][0].upper() + words[0][1:]
    return " ".join(words) + (f" ({unit})" if unit in _SHOWN_UNITS else "")


def reading(name: str, column: str, value: str) -> str:
    """What people read for a value of a column, such as "no verb in front" for no_verb: the words
    of its schema, else the value, with spaces where the column holds words of ours. Raises what
    `heading` raises.
    """
    declared = table(name).column(column)
    ours = declared.dictionary or declared.values
    return dict(declared.words).get(value, value.replace("_", " ") if ours else value)


def plain(value: object) -> str | None:
    """A truth or a number as people read it; None for any other value."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 1000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else None
