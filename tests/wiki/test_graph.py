"""Links, categories, other titles and recipes of an invented wiki, against what it was made of."""

import dataclasses
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.core.config.profile import load_profile
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.filters.filter_run import run_clean
from kb.sandbox.domain import domain_of
from kb.sandbox.wiki.generated import GeneratedRecipe, GeneratedWiki
from kb.sandbox.world import World
from kb.wiki.card import QUESTIONS
from kb.wiki.crawl.connector import crawl
from kb.wiki.parse.graph import recipe_edges
from tests.faults import Sandbox
from tests.recipes import export, release


def without_model(run: Run) -> Run:
    off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
    return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))


@pytest.fixture(scope="module")
def world() -> World:
    return World(domain=domain_of(load_profile("minecraft")), n_named=10)


@pytest.fixture(scope="module")
def root(world, run_on, tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("graph") / "data"
    with Sandbox(world, services=["wiki"]) as services:
        run = run_on(root, services.settings()["KB_WIKI_URL"])
        crawl(run)
        run = without_model(run)
        run_clean(run, "wiki")
        export(run, "wiki")
        release(run, ["wiki"])
    return root


@pytest.fixture(scope="module")
def site(world) -> GeneratedWiki:
    return GeneratedWiki(world.domain, 10)


@pytest.fixture(params=["clean", "release"])
def table(root, request):
    """The rows of a table of the wiki, in clean/ or in release/."""

    def rows(name: str, what: str = "*") -> list[Any]:
        files = root / request.param / "wiki" / (f"{name}/*" if request.param == "clean" else name)
        return duckdb.sql(f"SELECT {what} FROM '{files}*.parquet'").fetchall()

    return rows


def edges_of(title: str, recipe: GeneratedRecipe) -> Iterator[tuple[Any, ...]]:
    """What the rows of an invented recipe should say."""
    inputs: dict[tuple[str, ...], int] = {}
    for things, quantity in (slot for row in recipe.rows for slot in row):
        if things:
            inputs[things] = inputs.get(things, 0) + quantity
    for things, quantity in inputs.items():
        for (made,), pieces in recipe.outcome:
            yield recipe.station, made, pieces, things[0], quantity, list(things[1:]), title


def test_recipes_are_those_of_the_invented_wiki(table, site) -> None:
    """Every station, alternatives, slots that add up, and a container that comes back."""
    recipes = {one.title: recipe for one in site.entries if (recipe := site.recipe(one.title))}
    assert {recipe.station for recipe in recipes.values()} == {
        *("crafting", "smelting", "brewing", "trading", "other")
    }
    expected = [edge for title, recipe in recipes.items() for edge in edges_of(title, recipe)]
    pages = dict(table("pages", "page_id, title"))
    what = "station, product, product_quantity, ingredient, ingredient_quantity, alternatives"
    found = [
        (*row, pages[page])
        for *row, page in table("recipe_edges", f"{what}, page_id")
        if pages[page] in recipes
    ]
    assert sorted(found) == sorted(expected)
    ids = table("recipe_edges", "count(*), count(DISTINCT (recipe_id, slot, product_slot))")
    assert ids[0][0] == ids[0][1]


# Read by hand from the recorded pages: station, outcome, what goes in, alternatives, page.
RECORDED = {
    ("other", "Net", "Cord 0", 1, ("Cord 1", "Cord 2", "Cord 3"), "Net loom"),
    ("other", "Net", "Cord 1", 1, (), "Net loom"),
    ("other", "Net", "Cord 2", 1, ("Cord 3",), "Net loom"),
}


def test_recipes_of_the_recorded_pages_are_those_that_a_person_reads(table, site) -> None:
    pages = dict(table("pages", "page_id, title"))
    what = "station, product, ingredient, ingredient_quantity, alternatives, page_id"
    found = {(*row[:4], tuple(row[4]), pages[row[5]]) for row in table("recipe_edges", what)}
    invented = {entry.title for entry in site.entries}
    assert {row for row in found if row[-1] not in invented} == RECORDED


def test_things_lead_to_their_pages(table) -> None:
    by_title = {title: page for page, title in table("pages", "page_id, title")}
    for product, page, thing, other in table(
        "recipe_edges", "product, product_page_id, ingredient, ingredient_page_id"
    ):
        assert (page, other) == (by_title.get(product), by_title.get(thing))


def test_links_lead_to_kept_pages_by_title_or_redirect(table, site) -> None:
    by_title = {title: page for page, title in table("pages", "page_id, title")}
    redirects = dict(table("redirects", "title, page_id"))
    assert redirects == {
        other: by_title[one.title] for one in site.entries for other in one.redirects
    } | {"Rock salt": by_title["Saltstone"]}
    links = table("page_links", "target_title, target_page_id, section, region, text, count")
    for title, page, *_ in links:
        assert page == by_title.get(title, redirects.get(title))
    assert {section for _, _, section, *_ in links} > {""}
    assert {region for *_, region, _, _ in links} >= {"content", "infobox", "navbox"}


def test_categories_are_those_that_the_wiki_names(table, site) -> None:
    pages = dict(table("pages", "page_id, title"))
    found: dict[str, set[str]] = {}
    for page, category in table("categories", "page_id, category"):
        found.setdefault(pages[page], set()).add(category)
    for entry in site.entries:
        assert found[entry.title] == {"All", entry.kind}


def test_a_page_in_python_has_its_text_links_and_pictures(root, site) -> None:
    data = kb.load(root / "release")
    page = data.page(site.entries[1].title)
    assert page.text.startswith(f"# {page.title}\n\n")
    assert "## Recipe" in page.text
    assert {row["target_title"] for row in page.links} <= {*data["wiki_pages"].to_pandas().title}
    assert page.images.open(0).size == (page.images[0]["width"], page.images[0]["height"])


def test_the_tree_of_a_thing_has_what_goes_into_what_goes_into_it(root, site) -> None:
    data = kb.load(root / "release")
    title = site.entries[1].title
    recipe = site.recipe(title)
    tree = data.recipe_tree(title.upper(), 3)
    assert (tree["item"], tree["quantity"], tree["station"]) == (title, 3, recipe.station)
    # Two come out at a time, so for three it is made twice.
    needs = {(need["item"], need["quantity"]) for need in tree["needs"]}
    assert needs == {
        (things, 2 * quantity)
        for _, made, _, things, quantity, *_ in edges_of(title, recipe)
        if made == title
    }
    nodes, above = [], [(tree, ())]
    while above:
        node, path = above.pop()
        nodes.append(node)
        assert node.get("cycle", False) == (node["item"] in path)
        assert bool(node["needs"]) == bool(node["station"])
        above += [(need, (*path, node["item"])) for need in node["needs"]]
    assert any(node.get("cycle") for node in nodes)
    with pytest.raises(UsageError, match="Did you mean"):
        data.recipe_tree(title[:-1] + "q")


def slot(number: int, role: str, *things: tuple[str | None, int | None]) -> list[dict[str, Any]]:
    """Rows of wiki/recipes of one slot, which shows the things in turn."""
    own = {"page_id": 1, "recipe_index": 0, "slot": number, "role": role, "revision_id": 5}
    return [{**own, "item": item, "quantity": n, "element_id": None} for item, n in things]


EDGES = {
    "shown in turn with its ingredient": (
        [*slot(0, "input", ("Oak", 1), ("Birch", 1)), *slot(1, "input", ("Saw", 1)),
         *slot(2, "output", ("Oak board", 4), ("Birch board", 4))],
        [("1-0-0", "Oak board", "Oak", 1, []), ("1-0-0", "Oak board", "Saw", 1, []),
         ("1-0-1", "Birch board", "Birch", 1, []), ("1-0-1", "Birch board", "Saw", 1, [])],
    ),
    "one of several by chance": (
        [*slot(0, "input", ("Sack", 1)), *slot(1, "output", ("Ash", 1), ("Salt", 2))],
        [("1-0", "Ash", "Sack", 1, []), ("1-0", "Salt", "Sack", 1, [])],
    ),
    "equal slots, empty ones and unread numbers": (
        [*slot(0, "input", ("Ash", 1)), *slot(1, "input", (None, None)),
         *slot(2, "input", ("Ash", 2)), *slot(3, "input", ("Ash", 1), ("Salt", 1)),
         *slot(4, "input", ("Salt", None)), *slot(5, "input", ("Salt", 1)),
         *slot(6, "output", ("Glaze", 1))],
        [("1-0", "Glaze", "Ash", 3, []), ("1-0", "Glaze", "Ash", 1, ["Salt"]),
         ("1-0", "Glaze", "Salt", None, [])],
    ),
    "no outcome": ([*slot(0, "input", ("Cord", 1))], [("1-0", None, "Cord", 1, [])]),
    "nothing that goes in": (slot(0, "output", ("Jar", 1)), []),
}  # fmt: skip


@pytest.mark.parametrize("case", EDGES)
def test_edges_of_a_grid(case: str) -> None:
    slots, expected = EDGES[case]
    names = ("recipe_id", "product", "ingredient", "ingredient_quantity", "alternatives")
    found = recipe_edges(slots, [], [["mcui"]], {})
    assert [tuple(edge[name] for name in names) for edge in found] == expected


def test_a_page_that_is_not_kept_leaves_every_table_and_is_no_target(root, run_on, tmp_path):
    copied = tmp_path / "data"
    shutil.copytree(root, copied)

    def rows(sql: str, at: Path = copied) -> list[Any]:
        return duckdb.sql(sql.replace("{}", f"{at}/clean/wiki")).fetchall()

    # One word more than the shortest page that another one links to.
    ((words,),) = rows(
        """SELECT min(target.word_count) FROM '{}/page_links/*.parquet' AS link
        JOIN '{}/pages/*.parquet' AS target ON target_page_id = target.page_id
        JOIN '{}/pages/*.parquet' AS page ON link.page_id = page.page_id
        WHERE page.word_count > target.word_count"""
    )
    run = without_model(run_on(copied, "http://127.0.0.1:1", wiki={"min_words": words + 1}))
    run_clean(run, "wiki")
    kept = {page for (page,) in rows("SELECT page_id FROM '{}/pages/*.parquet'")}
    before = {page for (page,) in rows("SELECT page_id FROM '{}/pages/*.parquet'", root)}
    assert kept < before
    for name in ("page_text", "page_links", "categories", "redirects", "recipe_edges"):
        assert {page for (page,) in rows(f"SELECT page_id FROM '{{}}/{name}/*.parquet'")} <= kept
    for name, columns in (
        ("page_links", ["target_page_id"]),
        ("recipe_edges", ["product_page_id", "ingredient_page_id"]),
    ):
        for column in columns:
            targets = {page for (page,) in rows(f"SELECT {column} FROM '{{}}/{name}/*.parquet'")}
            assert targets - {None} <= kept
    titles = dict(rows("SELECT title, page_id FROM '{}/pages/*.parquet'", root))
    links = rows("SELECT target_title, target_page_id FROM '{}/page_links/*.parquet'")
    assert {page for title, page in links if titles.get(title, 0) in before - kept} == {None}


@pytest.mark.parametrize("layout", ["text", "minedojo"])
def test_a_download_is_exported_elsewhere_as_its_root_is(root, tmp_path, here, layout) -> None:
    download, out = tmp_path / "wiki", tmp_path / "out"
    shutil.copytree(root / "release/wiki", download)
    asked = ("wiki", "export", "--format", layout, "--data", str(download))
    assert here(*asked).code == 2
    before = sorted(download.iterdir())
    done = here(*asked, "--out", str(out))
    assert done.code == 0, done.err
    assert sorted(download.iterdir()) == before
    done = here("wiki", "export", "--format", layout, "--data", str(root), "--out", f"{out}-root")
    assert done.code == 0, done.err
    made, expected = (
        {path.relative_to(at): path.read_bytes() for path in at.rglob("*") if path.is_file()}
        for at in (out, Path(f"{out}-root"))
    )
    assert made.keys() == expected.keys() != set()
    assert made == expected
    if layout == "text":
        texts = {
            row["id"]: row["text"] for row in map(json.loads, made[Path("wiki.jsonl")].splitlines())
        }
        rows = duckdb.sql(f"SELECT page_id, text FROM '{download}/page_text-*.parquet'").fetchall()
        assert {str(page): text for page, text in rows} == texts


def test_the_card_answers_what_a_reader_asks(root, site) -> None:
    """Each question with its rows, by a query that finds the same in a copy."""
    text = (root / "release/wiki/README.md").read_text(encoding="utf-8")
    asked = re.findall(
        r"\*\*([^*\n]+\?)\*\*\n\n```sql\n(.*?);\n```\n\n((?:\|[^\n]*\n)+)", text, re.DOTALL
    )
    assert [question for question, *_ in asked] == [*QUESTIONS][:4]  # links are not released
    data = kb.load(root / "release")
    for _, query, table in asked:
        found = data.sql(query)
        head, _, *rows = table.splitlines()
        assert head == "| " + " | ".join(found.columns) + " |"
        assert len(rows) == len(found) > 0
