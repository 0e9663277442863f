"""Facts and recipes, against what a real MediaWiki was given to render: each infobox and recipe of
a page differs from the first in one slot, and so must its rows.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.profile import load_profile
from kb.filters.clean import run_clean
from kb.wiki import shown
from kb.wiki.source import crawl
from tests.wiki import workshop

UNITS = shown.UNITS
IDS = ("page_id", "recipe_id", "fact_id", "element_id", "visible", "revision_id")


def bare(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name not in IDS} for row in rows]


def table(run, name: str) -> list[dict[str, Any]]:
    return pq.read_table(run.root / "clean/wiki" / name).to_pylist()


def grouped(run, name: str, key: str) -> list[list[dict[str, Any]]]:
    """The rows of each recipe."""
    held: dict[int, list[dict[str, Any]]] = {}
    for row in table(run, name):
        held.setdefault(row[key], []).append(row)
    return list(held.values())


@pytest.fixture(scope="module")
def run(mediawiki, programs, run_on, tmp_path_factory):
    """The workshop's page, crawled and filtered."""
    root = tmp_path_factory.mktemp("workshop")
    made = run_on(root / "data", mediawiki.url)
    off = made.profile.toxicity.model_copy(update={"toxicity": "off"})
    made = dataclasses.replace(made, profile=made.profile.model_copy(update={"toxicity": off}))
    (root / "titles.txt").write_text("Workshop\n")
    crawl(made, root / "titles.txt")
    run_clean(made, "wiki")
    return made


@pytest.mark.mediawiki
def test_each_recipe_is_what_was_written_slot_for_slot(run):
    written = list(workshop.recipes())
    found = grouped(run, "recipes", "recipe_id")
    assert len(found) == len(written) > 40
    base = bare(found[0])
    for (slot, recipe), rows in zip(written, found, strict=True):
        assert bare(rows) == workshop.expected_recipe(recipe)
        differ = [row for row in bare(rows) if row not in base]
        differ += [row for row in base if row not in bare(rows)]
        assert {row["slot"] for row in differ} == ({slot} if slot is not None else set())


@pytest.mark.mediawiki
def test_each_infobox_is_what_was_written_field_for_field(run):
    written = [box for _, box in workshop.boxes()]
    expected = [row for box in written for row in workshop.expected_facts(box)]
    assert bare(table(run, "facts")) == expected
    assert [row["fact_id"] for row in table(run, "facts")] == list(range(len(expected)))


@pytest.mark.mediawiki
def test_facts_and_recipes_name_their_elements_and_revision(run):
    (page,) = table(run, "pages")
    by_id = {row["element_id"]: row for row in table(run, "elements")}
    facts, recipes = table(run, "facts"), table(run, "recipes")
    assert {row["revision_id"] for row in facts + recipes} == {page["revision_id"]}
    assert all(row["visible"] for row in facts + recipes)
    for row in facts:
        held = by_id[row["element_id"]]
        assert (held["kind"], held["region"]) in (("cell", "infobox"), ("text", "infobox"))
        assert held["text"].startswith(row["value"])
    for row in recipes:
        if row["element_id"] is None:
            assert row["item"] is None
        else:
            held = by_id[row["element_id"]]
            assert held["region"] == "recipe"
            assert held["kind"] in ("image", "animation")


@pytest.mark.mediawiki
def test_an_edit_of_one_slot_changes_that_slot(run, mediawiki):
    """Runs last: it changes the wiki."""
    before = bare(table(run, "recipes"))
    first = list(workshop.BASE)
    first[4] = (workshop.Thing("Salt", 1), workshop.Thing("Sand", 2))
    mediawiki.edit("Workshop", workshop.text(tuple(first)))
    titles = run.root.with_name("titles.txt")
    crawl(dataclasses.replace(run, again=True), titles)
    run_clean(run, "wiki")
    after = bare(table(run, "recipes"))
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert [(new["slot"], new["item"], new["quantity"]) for _, new in changed] == [(4, "Sand", 2)]
    (page,) = table(run, "pages")
    assert {row["revision_id"] for row in table(run, "recipes")} == {page["revision_id"]}


# -- without a wiki -------------------------------------------------------------------------------


@given(
    st.one_of(
        st.integers(0, 10**7).map(lambda n: f"{n:,}"), st.floats(0, 999).map("{:.2f}".format)
    ),
    st.sampled_from(UNITS),
    st.sampled_from(["", " ", "\u00a0"]),
)
def test_a_figure_with_a_unit_is_told_apart(figure, unit, space):
    assert shown.measured("Field", f"{figure}{space}{unit}", UNITS) == (figure, unit)
    assert shown.measured("Field", f"{figure} {unit} more", UNITS) == (
        f"{figure} {unit} more",
        None,
    )
    assert shown.measured(f"Field ({unit})", figure, UNITS) == (figure, unit)
    assert shown.measured("Field", figure, UNITS) == (figure, None)


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
    assert shown.measured("Field", value, UNITS) == told


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
    assert shown.name(item(**given), load_profile("minecraft").wiki.markup.item) == name


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
    assert shown.quantity(item(**given)) == quantity
