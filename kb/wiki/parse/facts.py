"""Makes wiki/facts and wiki/recipes from the infoboxes and recipes of an extraction.

The extraction has texts as shown. Names and units are derived here, by the profile's rules, so that
other rules need no new crawl. Pages captured by versions before these tables have no rows in them.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

Row = dict[str, Any]

UNITS = (
    *("%", "°", "°C", "°F", "K", "mm", "cm", "dm", "m", "km", "in", "ft", "yd", "mi", "m²", "km²"),
    *("px", "mg", "g", "kg", "t", "oz", "lb", "lbs", "ml", "mL", "cl", "dl", "l", "L", "m³", "tsp"),
    *("tbsp", "cup", "cups", "pint", "pints", "quart", "quarts", "serving", "servings", "portion"),
    *("portions", "piece", "pieces", "ms", "s", "sec", "second", "seconds", "min", "mins"),
    *("minute", "minutes", "h", "hr", "hrs", "hour", "hours", "day", "days", "week", "weeks"),
    *("month", "months", "year", "years", "m/s", "km/h", "mph", "kcal", "kJ", "calories", "V", "W"),
    *("kW", "Hz", "gram", "grams", "kilogram", "kilograms", "metre", "metres", "meter", "meters"),
)

# Figures as wikis write them: 2, 1,000, 1.5, −3, ½, 1 1/2, 3–5, ~20, 1 000.
_FIGURE = (
    r"[~≈<>±+\-−]?\s?"
    r"(?:\d[\d.,]*(?:[ \u00a0\u202f]\d{3})*(?:\s?\d+/\d+|/\d+)?\s?[½⅓⅔¼¾⅛]?|[½⅓⅔¼¾⅛])"
)
_RANGE = rf"{_FIGURE}(?:\s?[–\-−]\s?{_FIGURE}|\s(?:to|x|×)\s{_FIGURE})?"
_LONGEST = 80  # characters of a figure with its unit
# A picture's text that begins with its file's name says what the file is, not what it shows.
_FILE = re.compile(r".+?\.(?:png|gif|jpe?g|svg|webp|apng)\b", re.IGNORECASE)
_FORMATTING = re.compile(r"[&§][0-9a-fk-or]", re.IGNORECASE)  # colours in tooltips of games
_AMOUNT = re.compile(r"[×x]?\s?(\d[\d.,\s]*)\s?[×x]?")
_ESCAPED = re.compile(r"\\([&/\\])")


class MarkupRules(NamedTuple):
    """Of the profile's markup: units besides the usual ones, the expression of names in long texts,
    and words that name the stations of recipes.
    """

    units: tuple[str, ...] = ()
    item: str = ""
    stations: Mapping[str, tuple[str, ...]] = {}


def facts(page: Mapping[str, Any], entries: Iterable[Row], rules: MarkupRules) -> list[Row]:
    """Rows of wiki/facts of a page with `page_id`, `title` and `revision_id`.

    Fields that say nothing are left out.
    """
    rows: list[Row] = []
    for entry in entries:
        field, value = entry["field"].strip(), entry["value"].strip()
        field, value = field.rstrip(":：").rstrip(), value.lstrip(":：").lstrip()
        if not field or not value:
            continue
        value, unit = split_unit(field, value, (*UNITS, *rules.units))
        rows.append(
            {
                "page_id": page["page_id"],
                "fact_id": len(rows),
                "subject": (entry["subject"] or "").strip() or page["title"],
                "field": field,
                "value": value,
                "unit": unit,
                "element_id": entry["element"],
                "visible": entry["visible"],
                "revision_id": page["revision_id"],
            }
        )
    return rows


def split_unit(field: str, value: str, units: tuple[str, ...]) -> tuple[str, str | None]:
    """The value without its unit, and the unit; the value as it is where it has none.

    A unit stands behind a figure or a range of two ("2 kg", "3–5 minutes", "90%"), or in brackets
    at the end of the field's name ("Weight (kg)").
    """
    if len(value) > _LONGEST:
        return value, None
    behind, alone, named = _measures(units)
    if match := behind.fullmatch(value):
        return match[1].strip(), match[2]
    if (match := named.search(field)) and alone.fullmatch(value):
        return value, match[1]
    return value, None


@cache
def _measures(units: tuple[str, ...]) -> tuple[re.Pattern[str], re.Pattern[str], re.Pattern[str]]:
    # The longest first: "m/s" before "m". None at all: nothing is one.
    words = sorted(units, key=len, reverse=True)
    unit = "|".join(map(re.escape, words)) or r"(?!)"
    return (
        re.compile(rf"({_RANGE})\s?({unit})"),
        re.compile(_RANGE),
        re.compile(rf"\(({unit})\)$"),
    )


def recipes(page: Mapping[str, Any], entries: Iterable[Row], rules: MarkupRules) -> list[Row]:
    """Rows of wiki/recipes of a page with `page_id` and `revision_id`."""
    return [
        {
            "page_id": page["page_id"],
            "recipe_index": number,
            "slot": place,
            "role": "output" if slot["output"] else "input",
            "row_index": slot["row"],
            "column_index": slot["column"],
            "alternative": turn,
            "item": item_name(item, rules.item),
            "quantity": quantity(item),
            "element_id": slot["element"],
            "visible": slot["visible"],
            "revision_id": page["revision_id"],
        }
        for number, recipe in enumerate(entries)
        for place, slot in enumerate(recipe["slots"])
        for turn, item in enumerate(slot["items"])
    ]


def item_name(item: Row, expression: str) -> str | None:
    """What a thing in a slot is called, None where nothing lies there or says so."""
    return next((candidate for candidate in _names(item, expression) if candidate), None)


def _names(item: Row, expression: str) -> Iterator[str]:
    if item["tip"]:
        yield _ESCAPED.sub(r"\1", _FORMATTING.sub("", item["tip"])).strip()
    alt = " ".join((item["alt"] or "").split())
    named = name_inside(alt, expression) or ""
    if not _FILE.match(named):
        yield named
    title = " ".join((item["title"] or "").split())
    if item["absent"]:  # MediaWiki's words on a page that is not there, in any language
        title = re.sub(r" ?\([^()]*\)$", "", title)
    yield title
    yield item["label"] or ""
    yield item["text"] or ""
    if match := _FILE.match(alt):  # better than nothing
        yield match[0].rpartition(".")[0]


def name_inside(text: str | None, expression: str) -> str | None:
    """The name that stands inside of a picture's longer text, by the profile's expression; the text
    itself where there is none.
    """
    if not text or not expression or not (match := re.search(expression, text)):
        return text
    return (match[1] or "").strip() or text


def quantity(item: Row) -> int | None:
    """How many there are, 1 where nothing is said, None of nothing and of no whole number."""
    text = item["quantity"]
    if not text:
        return 1 if item["filled"] or item["text"] else None
    match = _AMOUNT.fullmatch(text.strip())
    if not match:
        return None
    digits = re.sub(r"[,\s]", "", match[1])
    return int(digits) if digits.isascii() and digits.isdecimal() and len(digits) < 19 else None
