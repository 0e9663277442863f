"""Facts and recipes of markup that MediaWiki's own packages don't have, and what is told from their
texts. Against a real MediaWiki: test_mediawiki.py.
"""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.errors import ItemFinal
from kb.wiki.parse import facts
from kb.wiki.section import Markup

UNITS = facts.UNITS
MINECRAFT = load_profile("minecraft").wiki.markup
RULES = facts.MarkupRules(MINECRAFT.units, MINECRAFT.item)
PAGE = {"page_id": 1, "title": "The page", "revision_id": 5}


def seen(pages, look, name: str, body: str):
    """(facts, recipes) of a page of that body."""
    html = f"<!DOCTYPE html><body><div id=content>{body}</div>"
    extraction = look(pages.put(f"/shown/{name}", html)).extraction
    return (
        facts.facts(PAGE, extraction["facts"], RULES),
        facts.recipes(PAGE, extraction["recipes"], RULES),
    )


def test_infoboxes_of_other_wikis(pages, look):
    body = """
      <div class="notaninfobox"><div class="infobox-title">Torch</div>
        <table class="infobox-rows"><tr><th>Tool</th><td><img alt="Any"> <img alt="Axe"></td></tr>
        <tr><th>Burns</th><td>20 ticks<br>for ever</td></tr><tr><th>Drops</th><td> </td></tr>
        <tr style="display:none"><th>Secret</th><td>12 ticks</td></tr></table></div>
      <table class="infobox"><tr><th>A</th><td>1</td><th>B</th><td>2</td></tr>
        <tr><td>Time</td><td>30 min</td></tr><tr><td><img alt="x"></td><td>caption</td></tr>
        <tr><th colspan=2>Section</th></tr><tr><td colspan=2>words below it</td></tr>
        <tr><th>Held</th><td>before<table><tr><th>Inner</th><td>7 days</td></tr></table></td></tr>
      </table>
      <aside class="portable-infobox"><table class="pi-horizontal-group"><thead>
        <tr><th>Mass (kg)</th><th>Hue</th></tr></thead>
        <tbody><tr><td>1,200</td><td>red</td></tr></tbody></table></aside>
      <table class="wikitable"><tr><th>No</th><td>fact</td></tr></table>"""
    facts, recipes = seen(pages, look, "boxes", body)
    assert [
        (row["subject"], row["field"], row["value"], row["unit"], row["visible"]) for row in facts
    ] == [
        ("Torch", "Tool", "Any\nAxe", None, True),
        ("Torch", "Burns", "20 ticks\nfor ever", None, True),
        ("Torch", "Secret", "12", "ticks", False),
        ("The page", "A", "1", None, True),
        ("The page", "B", "2", None, True),
        ("The page", "Time", "30", "min", True),
        ("The page", "Section", "words below it", None, True),
        ("The page", "Held", "before", None, True),
        ("The page", "Mass (kg)", "1,200", "kg", True),
        ("The page", "Hue", "red", None, True),
    ]
    assert recipes == []


BOXES = {
    "names and heads over several rows": (
        """<table class=infobox><tr><td colspan=3><img src=/none.png alt=Kiln></td></tr>
        <tr><th rowspan=2>Drops</th><td>Stone</td><td>2</td></tr><tr><td>Pebble</td><td>1</td></tr>
        <tr><th></th><th colspan=2>Mode</th></tr><tr><th></th><th>Easy</th><th>Hard</th></tr>
        <tr><th>Damage</th><td>3</td><td>5</td></tr><tr><th colspan=3>Place</th></tr>
        <tr><td colspan=3>by the river</td></tr><tr><th rowspan=2>Size</th><th>Wide</th>
        <td>1 m</td></tr><tr><th>Tall</th><td>2 m</td></tr></table>""",
        [
            ("The page", "Drops", "Stone"),
            ("The page", "Drops", "2"),
            ("The page", "Drops", "Pebble"),
            ("The page", "Drops", "1"),
            ("The page", "Damage › Mode › Easy", "3"),
            ("The page", "Damage › Mode › Hard", "5"),
            ("The page", "Place", "by the river"),
            ("The page", "Size › Wide", "1"),
            ("The page", "Size › Tall", "2"),
        ],
    ),
    "a table in a cell": (
        """<table class=infobox><tr><th>Held</th><td>yes<table><caption>Inner</caption>
        <tr><th>Head</th></tr><tr><th>Pebble</th><td>1</td></tr></table></td></tr></table>""",
        [("The page", "Held", "yes")],
    ),
    "the same name in several groups": (
        """<table class=infobox><tr><th colspan=2>Kiln</th></tr>
        <tr><th colspan=2>Heat</th></tr><tr><th>Total</th><td>9</td></tr>
        <tr><th colspan=2>Wood</th></tr><tr><th>Total</th><td>4</td></tr>
        <tr><th>Kind</th><td>Oak</td></tr></table>""",
        [("Kiln", "Heat › Total", "9"), ("Kiln", "Wood › Total", "4"), ("Kiln", "Kind", "Oak")],
    ),
    "pictures between words": (
        """<table class=infobox><tr><th>Health</th><td>20 (<img src=/none.png alt=Heart> × 10)</td>
        </tr><tr><th>Tool</th><td><img src=/none.png alt=Axe> Axe</td></tr></table>""",
        [("The page", "Health", "20 (Heart × 10)"), ("The page", "Tool", "Axe")],
    ),
    "no table": (
        """<div class="infobox"><div class=infobox-title>Kiln</div><div class=row>
        <div class=label>Made of</div><div class=value>clay</div></div>
        <dl><dt>Hue</dt><dd>red</dd><dd>blue</dd></dl>
        <p><b>Built:</b> in 1900<br><strong>By</strong> Tamsin</p></div>""",
        [
            ("Kiln", "Made of", "clay"),
            ("Kiln", "Hue", "red"),
            ("Kiln", "Hue", "blue"),
            ("Kiln", "Built", "in 1900"),
            ("Kiln", "By", "Tamsin"),
        ],
    ),
    "a value below several heads, and names with a colon behind": (
        """<table class=infobox><tr><th></th><th>Easy</th><th>Hard</th></tr>
        <tr><th>Fuel</th><td colspan=2>wood</td></tr></table>
        <div class=infobox><ul><li><b>Wide</b>: 3 m</li></ul></div>""",
        [
            ("The page", "Fuel › Easy", "wood"),
            ("The page", "Fuel › Hard", "wood"),
            ("The page", "Wide", "3"),
        ],
    ),
    "a bold title before what has names of its own": (
        """<div class=infobox><b>Kiln</b><dl><dt>Hue</dt><dd>red</dd></dl></div>
        <div class=infobox><strong>Pot</strong><img src=/none.png alt=Jug><section><h3>Shape:</h3>
        <dl><div><dt><b>Wide</b> :</dt><dd>3 m</dd></div></dl></section></div>
        <div class=infobox><b>Oven</b><div><span class=label>Fuel</span> <i>wood</i></div>
        <p><b>Heat</b>: 700</p></div>
        <aside class=infobox><b>Shelf</b><ul><li>upper</li><li>lower</li></ul></aside>
        <div class=infobox><div><b>Clay</b><p>It is dug by the river.</p></div></div>""",
        [
            ("The page", "Hue", "red"),
            ("The page", "Wide", "3"),
            ("The page", "Fuel", "wood"),
            ("The page", "Heat", "700"),
        ],
    ),
    "a list within a value": (
        """<div class=infobox><b>Held</b>: yes<dl><dt>Size:</dt><dd>large<dl><dt>Wide</dt>
        <dd>3 m</dd><dt>Tall</dt><dd>4 m</dd></dl></dd></dl><b>By</b>: hand</div>""",
        [
            ("The page", "Held", "yes"),
            ("The page", "By", "hand"),
            ("The page", "Size", "large"),
            ("The page", "Size › Wide", "3"),
            ("The page", "Size › Tall", "4"),
        ],
    ),
    "colons behind names": (
        """<div class=infobox><div><b>Wide</b>:</div><div>3 m</div>
        <p><b>Tall</b>： 4 m<br><b>Deep :</b>&nbsp;: 5 m<br><b>Hue</b><span>:</span> red</p></div>
        <table class=infobox><tr><th colspan=3>Firing:</th></tr><tr><th rowspan=2>Time :</th>
        <th>First:</th><td>: 7</td></tr><tr><th>Second：</th><td>9</td></tr></table>""",
        [
            ("The page", "Wide", "3"),
            ("The page", "Tall", "4"),
            ("The page", "Deep", "5"),
            ("The page", "Hue", "red"),
            ("Firing", "Time › First", "7"),
            ("Firing", "Time › Second", "9"),
        ],
    ),
    "tabs": (
        """<aside class=portable-infobox><section class="pi-panel wds-tabber">
        <ul class=wds-tabs><li class=wds-tabs__tab>Old</li><li class=wds-tabs__tab>New</li></ul>
        <div class=wds-tab__content><div class=pi-data><h3 class=pi-data-label>Heat</h3>
        <div class=pi-data-value>5</div></div></div>
        <div class=wds-tab__content style="display:none"><div class=pi-data>
        <h3 class=pi-data-label>Heat</h3><div class=pi-data-value>9</div></div></div>
        </section></aside>""",
        [("The page", "Old › Heat", "5"), ("The page", "New › Heat", "9")],
    ),
    "a horizontal group of one": (
        """<aside class=portable-infobox><h2 class=pi-title>Kiln</h2>
        <table class=pi-horizontal-group><thead><tr><th>Age</th></tr></thead>
        <tbody><tr><td>old</td></tr></tbody></table></aside>""",
        [("Kiln", "Age", "old")],
    ),
}


def test_facts_of_boxes_as_wikis_write_them(pages, look):
    html = "".join(f"<div>{one}</div>" for one, _ in BOXES.values())
    rows, _ = seen(pages, look, "forms", html)
    found = [(row["subject"], row["field"], row["value"]) for row in rows]
    assert found == [fact for _, facts_of_box in BOXES.values() for fact in facts_of_box]


def test_rows_that_can_not_be_read_are_counted_and_make_no_facts(pages, look):
    body = """<table class=infobox><tr><td>1</td><td>2</td><td>3</td></tr>
      <tr><td colspan=3>See <b>also</b> pots</td></tr></table>"""
    url = pages.put("/shown/unread", f"<!DOCTYPE html><body><div id=content>{body}</div>")
    extraction = look(url).extraction
    assert extraction["facts"] == []
    assert extraction["page"]["unread_facts"] == 4


@pytest.mark.parametrize(
    "slash",
    [
        "",
        '<span class="slash" style="display:none">/</span>',
        '<span class="slash" style="position:absolute;clip:rect(0 0 0 0)">/</span>',
    ],
)
def test_stacked_fractions_keep_their_slash(pages, look, slash):
    def stacked(over: int, under: int) -> str:
        parts = f'<span class="num">{over}</span>{slash}<span class="den">{under}</span>'
        return f'<span class="sfrac"><span class="tion">{parts}</span></span>'

    style = "<style>.tion { display: inline-block } .num, .den { display: block }</style>"
    words = f"Odds: {stacked(82, 100)} × {stacked(499, 500)}, or 3<sup>1</sup>⁄<sub>2</sub>."
    box = f'<table class="infobox"><tr><th>Chance</th><td>{stacked(1, 12)} s</td></tr></table>'
    html = f"<!DOCTYPE html><div id=content>{style}<p>{words}</p>{box}</div>"
    extraction = look(pages.put("/shown/fractions", html)).extraction
    assert extraction["elements"][0]["text"] == "Odds: 82/100 × 499/500, or 31⁄2."
    (fact,) = facts.facts(PAGE, extraction["facts"], RULES)
    assert (fact["value"], fact["unit"]) == ("1/12", "s")


def test_fractions_and_notes_of_minecraft_wiki(pages, look):
    html = Path(__file__).with_name("markup").joinpath("fractions.html").read_text(encoding="utf-8")
    extraction = look(pages.put("/shown/minecraft-fractions", html)).extraction
    texts = [e["text"] for e in extraction["elements"] if e["kind"] in ("text", "cell")]
    assert texts[0] == "Chance of a full net: 82/100 × 499/500."
    assert [cell["text"] for cell in extraction["cells"]][:2] == ["Odds", "1/12"]
    rows = facts.facts(PAGE, extraction["facts"], RULES)
    assert [(row["field"], row["value"], row["unit"]) for row in rows] == [
        ("Tide", "3/4", "m"),
        ("Knots", "two lines", None),
    ]
    assert "Tide[note 2]" not in texts, "marks of footnotes are no text"


def test_recipes_of_minecraft_wiki(pages, look):
    """Tooltips with colours, long texts of pictures, sprites, turns in turns; no rows at all."""

    def item(name: str, more: str = "", shown: str = "") -> str:
        alt = f"Invicon {name}.png: Inventory sprite for {name} in Minecraft as shown in-game"
        link = f'<a href="/w/{name}" title="Elsewhere"><img alt="{alt}"></a>'
        return f'<span class="invslot-item{shown}">{link}{more}</span>'

    size = '<span class="invslot-stacksize">{}</span>'.format
    first = " animated-active"
    body = f"""<style>.animated > *, .animated-subframe > * {{ display: none }}
        .animated > .animated-active {{ display: block }} .s {{ background: url(/shown/s.png) }}
        .invslot {{ display: inline-block; width: 32px; height: 32px }}</style>
      <div class="mcui mcui-Furnace"><span class="mcui-input">
        <span class="invslot animated">{item("Coal", shown=first)}<span class="animated-subframe">
          {item("Log", size(4))}{item("Plank")}</span>{item("Lava")}</span>
        <span class="mcui-fuel"></span>
        <span class="invslot"><span class="invslot-item"
          data-minetip-title="&amp;6Golden &amp;oApple" title="x"><img alt=""></span></span></span>
        <span class="mcui-output"><span class="invslot invslot-large"><span class="s" title="Glass">
          </span>{size(64)}</span></span></div>
      <div style="display:none"><div class="mcui">
        <span class="invslot">{item("Bow")}</span></div></div>
      <p><span class="invslot">{item("Alone")}</span></p>"""
    facts, recipes = seen(pages, look, "grids", body)
    assert facts == []
    names = ("recipe_index", "slot", "role", "column_index", "alternative", "item", "quantity")
    assert [tuple(row[name] for name in (*names, "visible")) for row in recipes] == [
        (0, 0, "input", 0, 0, "Coal", 1, True),
        (0, 0, "input", 0, 1, "Log", 4, True),
        (0, 0, "input", 0, 2, "Plank", 1, True),
        (0, 0, "input", 0, 3, "Lava", 1, True),
        (0, 1, "input", 1, 0, "Golden Apple", 1, True),
        (0, 2, "output", 0, 0, "Glass", 64, True),
        (1, 0, "input", 0, 0, "Bow", 1, False),
    ]


def test_a_profile_that_names_no_grid_reads_no_recipe(pages, look, section):
    """The classes of one wiki stand in its profile: another one's grids are text and pictures."""
    rules = section.model_copy(update={"markup": Markup()}).rules
    grid = '<div class="mcui"><span class="invslot">Clay</span></div>'
    url = pages.put("/shown/plain", f"<!DOCTYPE html><div id=content><p>Jar</p>{grid}</div>")
    extraction = look(url, rules=rules).extraction
    assert extraction["recipes"] == []
    assert {element["region"] for element in extraction["elements"]} == {"content"}
    (read,) = look(url, rules=section.rules).extraction["recipes"]
    assert read


def test_more_slots_than_a_page_may_have_elements_are_too_many(pages, look):
    slots = '<span class="invslot"></span>' * 60
    url = pages.put("/shown/many", f"<!DOCTYPE html><div id=content><div class=mcui>{slots}</div>")
    with pytest.raises(ItemFinal, match="too_many_elements"):
        look(url, rules={"max_elements": 50})
    assert look(url, rules={"max_elements": 70}).extraction["recipes"]


# -- without a browser -----------------------------------------------------------------------------


@given(
    st.one_of(
        st.integers(0, 10**7).map(lambda n: f"{n:,}"), st.floats(0, 999).map("{:.2f}".format)
    ),
    st.sampled_from(UNITS),
    st.sampled_from(["", " ", "\u00a0"]),
)
def test_a_figure_with_a_unit_is_told_apart(figure, unit, space):
    assert facts.split_unit("Field", f"{figure}{space}{unit}", UNITS) == (figure, unit)
    assert facts.split_unit("Field", f"{figure} {unit} more", UNITS) == (
        f"{figure} {unit} more",
        None,
    )
    assert facts.split_unit(f"Field ({unit})", figure, UNITS) == (figure, unit)
    assert facts.split_unit("Field", figure, UNITS) == (figure, None)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("5 May", ("5 May", None)),
        ("kg", ("kg", None)),
        ("2 kg of clay", ("2 kg of clay", None)),
        ("1 1/2 cups", ("1 1/2", "cups")),
        ("½ cup", ("½", "cup")),
        ("−3 to 5 °C", ("−3 to 5", "°C")),
        ("12 m/s", ("12", "m/s")),
        ("~ 20 minutes", ("~ 20", "minutes")),
        ("9" * 100_000, ("9" * 100_000, None)),
    ],
)
def test_units(value, told):
    assert facts.split_unit("Field", value, UNITS) == told


def item(**given: Any) -> dict[str, Any]:
    nothing = dict.fromkeys(("tip", "alt", "title", "label", "text", "quantity"))
    return {**nothing, "filled": True, "absent": False, **given}


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"tip": "&bOak\\&Planks", "alt": "x"}, "Oak&Planks"),
        ({"alt": "Oak Planks", "title": "Planks"}, "Oak Planks"),
        (
            {
                "alt": "Invicon Bow.png: Inventory sprite for Bow in Minecraft as shown",
                "title": "B",
            },
            "Bow",
        ),
        ({"alt": "Invicon Bow.png: a picture", "title": "Bow"}, "Bow"),
        ({"alt": "Bow.png", "title": "Bogen (Seite nicht vorhanden)", "absent": True}, "Bogen"),
        ({"alt": "Invicon Bow.png"}, "Invicon Bow"),
        ({"text": "Flour"}, "Flour"),
        ({"filled": False}, None),
    ],
)
def test_names_of_things(given, name):
    assert facts.item_name(item(**given), load_profile("minecraft").wiki.markup.item) == name


@pytest.mark.parametrize(
    ("given", "quantity"),
    [
        ({}, 1),
        ({"quantity": "64"}, 64),
        ({"quantity": "× 1,000"}, 1000),
        ({"quantity": "1–3"}, None),
        ({"quantity": "1.5"}, None),
        ({"filled": False}, None),
        ({"filled": False, "text": "Flour"}, 1),
    ],
)
def test_quantities(given, quantity):
    assert facts.quantity(item(**given)) == quantity
