"""A page whose recipes and infoboxes are known: written out of plain values, with templates, and
each differing from the first in one slot or one field. Given under CC0 1.0.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

TEMPLATES = {
    "Template:Grid": '<div class="mcui"><span class="mcui-input">'
    '<span class="mcui-row">{{{1|}}}{{{2|}}}{{{3|}}}</span>'
    '<span class="mcui-row">{{{4|}}}{{{5|}}}{{{6|}}}</span>'
    '<span class="mcui-row">{{{7|}}}{{{8|}}}{{{9|}}}</span></span>'
    '<span class="mcui-arrow"></span><span class="mcui-output">{{{10|}}}</span></div>',
    "Template:Slot": '<span class="invslot{{{2|}}}">{{{1|}}}</span>',
    "Template:Thing": '<span class="invslot-item{{{shown|}}}">'
    "[[File:Dot.png|16px|link=|alt={{{1}}}]]{{{count|}}}</span>",
    "Template:Nothing": '<span class="invslot-item{{{shown|}}}"></span>',
    "Template:Count": '<span class="invslot-stacksize">{{{1}}}</span>',
}


class Thing(NamedTuple):
    """What lies in a slot; no name: nothing. `quantity` 1 is not written out."""

    name: str | None = None
    quantity: int | None = None


Slot = tuple[Thing, ...]  # several are shown in turn
EMPTY: Slot = (Thing(),)
Recipe = tuple[Slot, ...]  # three rows of three, then the outcome

BASE: Recipe = (
    *((Thing("Wet clay", 1),), EMPTY, (Thing("Ash", 2),)),
    *(EMPTY, (Thing("Salt", 1), Thing("Lime & salt", 3)), (Thing("Öl", 1),)),
    *((Thing("Twig", 1),), (Thing("Twig", 1),), EMPTY),
    (Thing("Glazed jar", 4),),
)

# (subject, (field, value, unit) …)
Box = tuple[str, tuple[tuple[str, str, str | None], ...]]
BOX: Box = (
    "Tall jar",
    (
        ("Weight", "2", "kg"),
        ("Kept", "in a dry place", None),
        ("Firing", "3–5", "hours"),
        ("Height (cm)", "1,020.5", "cm"),
        ("Breaks", "90", "%"),
    ),
)


def recipes() -> Iterator[tuple[int | None, Recipe]]:
    """The first recipe, then others with the number of the slot that differs."""
    yield None, BASE
    for number, slot in enumerate(BASE):
        things: tuple[Slot, ...] = (
            (Thing(f"Other {number}", 1),),
            (Thing("Wet clay", number + 7),),
            EMPTY,
            (Thing("One", 1), Thing("Two", 64), Thing("Three", 1)),
            (Thing("One", 2), Thing()),
        )
        for other in things:
            if other != slot:
                yield number, (*BASE[:number], other, *BASE[number + 1 :])


def boxes() -> Iterator[tuple[int | None, Box]]:
    """The first infobox, then others with the number of the field that differs."""
    yield None, BOX
    subject, rows = BOX
    for number, (field, _, unit) in enumerate(rows):
        changed = (
            (field, "7", unit) if unit else (field, "nowhere", None),
            (f"Other {number}", "not known", None),
            None,
        )
        for row in changed:
            fresh = (*rows[:number], *([row] if row else []), *rows[number + 1 :])
            yield number, (subject, fresh)
    yield 0, (subject, (("Weight", "2", "g"), *rows[1:]))
    yield 1, (subject, (rows[0], ("Kept", "first line\nsecond line", None), *rows[2:]))


def text(first: Recipe = BASE) -> str:
    """The page's wikitext; `first` in place of its first recipe."""
    grids = [first, *(recipe for _, recipe in recipes() if recipe != BASE)]
    shapes = (_table, _portable)
    held = "\n".join(shapes[n % 2](box) for n, (_, box) in enumerate(boxes()))
    return (
        "The workshop shows all that is made in the valley, and what each of the jars weighs,"
        " how long it is fired and where it is kept.\n\n"
        + "\n".join(map(_grid, grids))
        + f"\n{held}\n"
    )


def _grid(recipe: Recipe) -> str:
    return "{{Grid|" + "|".join(map(_slot, recipe)) + "}}"


def _slot(slot: Slot) -> str:
    if slot == EMPTY:
        return "{{Slot}}"
    if len(slot) == 1:
        return "{{Slot|" + _thing(slot[0]) + "}}"
    shown = [_thing(thing, " animated-active" if not n else "") for n, thing in enumerate(slot)]
    return "{{Slot|" + "".join(shown) + "|&#32;animated}}"


def _thing(thing: Thing, shown: str = "") -> str:
    more = f"|shown=&#32;{shown.strip()}" if shown else ""
    if thing.name is None:
        return "{{Nothing" + more + "}}"
    count = f"|count={{{{Count|{thing.quantity}}}}}" if thing.quantity != 1 else ""
    return "{{Thing|" + thing.name + count + more + "}}"


def _written(value: str, unit: str | None, field: str) -> str:
    if unit is None or f"({unit})" in field:
        return value.replace("\n", "<br>")
    return value + ("" if unit == "%" else " ") + unit


def _table(box: Box) -> str:
    subject, rows = box
    lines = ['{| class="infobox"', f'! colspan="2" | {subject}']
    lines += ["|-", '| colspan="2" | [[File:Tall.png|60px|alt=Seen from the front]]']
    for field, value, unit in rows:
        lines += ["|-", f"! {field}:", f"| {_written(value, unit, field)}"]
    return "\n".join([*lines, "|}"])


def _portable(box: Box) -> str:
    subject, rows = box
    held = "".join(
        f'<div class="pi-item pi-data"><h3 class="pi-data-label">{field}</h3>'
        f'<div class="pi-data-value">{_written(value, unit, field)}</div></div>'
        for field, value, unit in rows
    )
    return f'<div class="portable-infobox"><h2 class="pi-title">{subject}</h2>{held}</div>'


def expected_recipe(recipe: Recipe) -> list[dict[str, Any]]:
    """The rows of wiki/recipes that it must give, but for ids."""
    return [
        {
            "slot": number,
            "role": "output" if number == 9 else "input",
            "row_index": 0 if number == 9 else number // 3,
            "column_index": 0 if number == 9 else number % 3,
            "alternative": turn,
            "item": thing.name,
            "quantity": thing.quantity,
        }
        for number, slot in enumerate(recipe)
        for turn, thing in enumerate(slot)
    ]


def expected_facts(box: Box) -> list[dict[str, Any]]:
    """The rows of wiki/facts that it must give, but for ids."""
    subject, rows = box
    return [
        {"subject": subject, "field": field, "value": value, "unit": unit}
        for field, value, unit in rows
    ]
