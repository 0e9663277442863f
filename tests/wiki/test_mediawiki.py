"""The whole way on a real MediaWiki: crawl, edit, delete, move, crawl again, filter."""

import dataclasses
import re
from collections import Counter
from functools import partial
from itertools import groupby
from urllib.parse import unquote

import duckdb
import pytest
from PIL import Image

from kb.core.config.profile import load_profile
from kb.filters.filter_run import run_clean
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.wiki.browser.browser import Browser, Pool, reach
from kb.wiki.capture import page
from kb.wiki.crawl.connector import crawl
from tests.wiki import infobox_page as workshop
from tests.wiki.test_text import check_against_a_browser

pytestmark = pytest.mark.mediawiki

TITLES = {
    "Main Page",
    "Grids",
    "Pictures",
    "Frames",
    "Icons",
    "Hidden",
    "Regions",
    "Colours",
    "Empty images",
    "To be moved",
    "To be deleted",
    "Öfen & 窯 (100%)",
    "Workshop",
}


def unscored(run):
    """The same run without toxicity scores: they are another room's tests."""
    off = run.profile.toxicity.model_copy(update={"toxicity": "off"})
    return dataclasses.replace(run, profile=run.profile.model_copy(update={"toxicity": off}))


@pytest.fixture(scope="module")
def data(mediawiki, shared_browsers, run_on, tmp_path_factory):
    """A crawled and filtered data root: (run, crawl summary, filter summary)."""
    run = unscored(run_on(tmp_path_factory.mktemp("kiln"), mediawiki.url, workers=1))
    crawled = crawl(dataclasses.replace(run, workers=2))
    cleaned = run_clean(run, "wiki")
    return run, crawled, cleaned


def query(run, sql):
    """Rows of a query over the clean tables as dicts."""
    con = duckdb.connect()
    for name in ("pages", "elements", "cells", "images", "facts", "recipes"):
        con.execute(
            f"CREATE VIEW {name} AS SELECT * FROM"
            f" read_parquet('{run.root}/clean/wiki/{name}/*.parquet')"
        )
    return con.sql(sql).to_arrow_table().to_pylist()


def elements(run, title, where="true"):
    return query(
        run,
        f"SELECT e.* FROM elements e JOIN pages p USING (page_id) WHERE p.title = '{title}'"
        f" AND ({where}) ORDER BY reading_order",
    )


def test_every_page_is_answered(data):
    run, crawled, cleaned = data
    assert crawled["crawled"] == len(TITLES) + 1
    assert (crawled["failed"], crawled["pending"]) == (0, 0)
    assert cleaned["crawled"] == cleaned["kept"] + cleaned["rejected"]
    assert {row["title"] for row in query(run, "SELECT title FROM pages")} == TITLES | {"Stub"}


def test_each_page_is_asked_for_once(data, mediawiki):
    """The document and nothing else of it, also where images name the page itself; no tab icons."""
    asked = Counter()
    for request in mediawiki.requests():
        if request["agent"].startswith("lorecrawl") and request["dest"] is not None:
            asked[unquote(request["address"]), request["dest"]] += 1
    for title in TITLES:
        path = f"/wiki/{title.replace(' ', '_')}"
        assert asked.pop((path, "document")) == 1, title
    # The browser itself asks for src="#" and src="?", as any reader's does; not for src="". Two
    # name the page without a question mark: they are one request while the first is on its way.
    own = {key: asked.pop(key) for key in list(asked) if key[0].startswith("/wiki/Empty")}
    assert own.pop(("/wiki/Empty_images", "image")) <= 2
    assert own == {("/wiki/Empty_images?", "image"): 1}
    assert asked.pop(("/wiki/Stub", "document")) == 1
    assert not [path for path, _ in asked if path.startswith("/wiki/") or "favicon" in path]
    assert asked["/images/gone.png", "image"] == 1, "what is absent is not asked for again"


def test_pages_that_are_shown_are_not_fetched_as_picture_files(data, mediawiki):
    plain = [r["address"] for r in mediawiki.requests() if r["dest"] is None]
    assert not [address for address in plain if address.startswith("/wiki/Empty_images")]


def test_the_browser_asks_for_no_more_than_a_readers(mediawiki, programs, tmp_path):
    """Each page in a browser of ours and in one that only shows it: the same requests."""
    section = load_profile("minecraft").wiki
    hosts, origins = reach(mediawiki.url, ())
    asked = {}
    for name, before in (("reader", ""), ("ours", page.page_script("settle.js"))):
        start = partial(
            Browser,
            programs,
            hosts=hosts,
            origins=origins,
            user_agent=name,
            viewport=(1280, 1024),
            page_seconds=60,
            before=before,
        )
        with Pool(start, 120) as pool:
            for title in ("Pictures", "Empty_images", "Frames", "Icons", "Colours"):
                url = f"{mediawiki.url}/wiki/{title}"
                if before:
                    show = partial(
                        page.capture,
                        url=url,
                        shot=tmp_path / "screenshot.png",
                        rules=section.rules,
                        max_height=section.max_page_height,
                    )
                else:
                    show = partial(read, url=url)
                pool.use(show)
        seen = [r for r in mediawiki.requests() if r["agent"] == name]
        # Pictures of one address are one request while the first is on its way, else one each.
        own = {r["address"] for r in seen if r["dest"] == "image" and "/wiki/" in r["address"]}
        rest = [r["address"] for r in seen if r["dest"] != "image" or r["address"] not in own]
        asked[name] = Counter([*rest, *(f"{address} as a picture" for address in own)])
    assert asked["reader"]["/wiki/Pictures"] == 1
    assert asked["ours"] - asked["reader"] == Counter()


def read(browser, url):
    """What a reader does: open the page and scroll to its end, until nothing loads any more: no
    picture, and no module of MediaWiki, which may ask for others when it runs.
    """
    browser.go(url)
    browser.promise(
        """scrollTo(0, document.documentElement.scrollHeight);
        const states = () => mw.loader.getModuleNames().map((name) => mw.loader.getState(name));
        const left = () => [...document.images].some((img) => !img.complete)
          || states().some((one) => /^(loading|loaded|executing)$/.test(one));
        const frame = () => new Promise((done) => requestIdleCallback(done, { timeout: 1000 }));
        for (let still = 0; still < 3; still = left() ? 0 : still + 1) await frame();"""
    )


def test_page_rows_name_revision_licence_and_contributors(data, mediawiki):
    run, *_ = data
    (row,) = query(run, "SELECT * FROM pages WHERE title = 'Grids'")
    assert row["license"] == "CC-BY-SA-4.0"
    assert row["revision_timestamp"].year == 2024
    assert row["contributors_url"] == f"{mediawiki.url}/w/index.php?title=Grids&action=history"
    assert (row["viewport_width"], row["device_pixel_ratio"]) == (1280, 1.0)
    with Image.open(run.root / row["screenshot_path"]) as picture:
        assert picture.format == "PNG"
        assert picture.size == (row["page_width"], row["page_height"])


def test_grid_spans_and_nested_tables(data):
    run, *_ = data
    rows = query(
        run,
        "SELECT c.* FROM cells c JOIN pages p USING (page_id) WHERE title = 'Grids' ORDER BY"
        " table_id, row_index, column_index",
    )
    tables = sorted({row["table_id"] for row in rows})
    assert len(tables) == 3
    first = [
        (
            r["text"],
            r["row_index"],
            r["column_index"],
            r["row_span"],
            r["column_span"],
            r["is_header"],
        )
        for r in rows
        if r["table_id"] == tables[0]
    ]
    assert first == [
        ("Kiln", 0, 0, 2, 1, True),
        ("Heat", 0, 1, 1, 2, True),
        ("Low", 1, 1, 1, 1, True),
        ("High", 1, 2, 1, 1, True),
        ("North", 2, 0, 1, 1, False),
        ("700", 2, 1, 2, 1, False),
        ("900", 2, 2, 1, 1, False),
        ("South", 3, 0, 1, 1, False),
        ("950", 3, 2, 1, 1, False),
    ]
    texts = [row["text"] for row in rows]
    assert texts.count("deep one") == 1
    assert "before\nafter" in texts
    inner = next(
        e for e in elements(run, "Grids", "kind = 'table'") if e["element_id"] == tables[2]
    )
    holder = next(e for e in elements(run, "Grids") if e["element_id"] == inner["parent_id"])
    assert (holder["kind"], holder["text"]) == ("cell", "before\nafter")


def test_captions_and_originals(data, mediawiki):
    run, *_ = data
    rows = query(
        run,
        """SELECT i.*, region FROM images i JOIN pages p USING (page_id)
                         JOIN elements e USING (page_id, element_id)
                         WHERE title = 'Pictures' ORDER BY element_id""",
    )
    assert [(r["alt_text"], r["caption"], r["region"], r["width"], r["height"]) for r in rows] == [
        ("A tall jar", "The tall jar.", "content", 120, 400),
        (None, "The flat dish.", "content", 300, 200),
        ("In the gallery", "In the gallery", "gallery", 120, 400),
        ("Dish seen from above", "The dish again", "gallery", 300, 200),
        ("Boxed", "Dish in the box", "infobox", 300, 200),
    ]
    assert [r["license"] for r in rows[:2]] == ["CC-BY-4.0", None]
    for row in rows:
        assert "/thumb/" not in row["src"]
        assert row["path"] == f"raw/wiki/images/{row['sha256']}.png"
        with Image.open(run.root / row["path"]) as picture:
            assert picture.size == (row["width"], row["height"])


def test_frames_of_gif_apng_and_scripts(data):
    run, *_ = data
    rows = query(
        run,
        """SELECT i.*, kind FROM images i JOIN pages p USING (page_id)
                         JOIN elements e USING (page_id, element_id)
                         WHERE title = 'Frames' ORDER BY element_id, frame_index""",
    )
    assert [
        (r["kind"], r["media_type"], r["frame_index"], r["frame_duration_ms"]) for r in rows
    ] == [
        ("image", "image/gif", 0, 300),
        ("image", "image/gif", 1, 200),
        ("image", "image/gif", 2, 100),
        ("image", "image/png", 0, 500),
        ("image", "image/png", 1, 250),
        ("animation", "image/png", 0, 1500),
        ("animation", "image/png", 1, 1500),
        ("animation", "image/png", 2, 1500),
    ]
    assert [r["width"] for r in rows[-3:]] == [300, 120, 300]


def test_sprites_have_names_boxes_and_pixels(data):
    run, *_ = data
    rows = query(
        run,
        """SELECT e.text, e.width AS w, e.height AS h, i.* FROM elements e
                         JOIN pages p USING (page_id) JOIN images i USING (page_id, element_id)
                         WHERE title = 'Icons' AND kind = 'sprite' ORDER BY reading_order""",
    )
    assert [(r["text"], r["w"], r["h"]) for r in rows] == [
        ("Clay", 16, 16),
        ("Ash", 16, 16),
        ("Salt", 16, 16),
    ]
    colours = []
    for row in rows:
        with Image.open(run.root / row["path"]) as picture:
            assert picture.size == (16, 16)
            colours.append(picture.convert("RGB").getcolors())
    assert colours == [[(256, (250, 10, 120))], [(256, (40, 200, 40))], [(256, (40, 40, 200))]]


def test_hidden_is_recorded_as_hidden(data):
    run, *_ = data
    seen = {e["text"]: e["visible"] for e in elements(run, "Hidden", "kind = 'text'")}
    assert seen["Nobody sees this line of text."] is False
    assert seen["Nor what is folded away here."] is False
    assert seen["Nor what stands beside the page."] is False
    assert seen["Bare text stands without a paragraph"] is True
    assert seen["and another in a box."] is True
    (page,) = query(run, "SELECT word_count FROM pages WHERE title = 'Hidden'")
    shown = " ".join(text for text, visible in seen.items() if visible)
    assert page["word_count"] == len(shown.split())


def test_regions_headings_and_no_chrome(data):
    run, *_ = data
    found = elements(run, "Regions", "kind in ('text', 'cell')")
    assert {
        e["text"]: e["heading_level"]
        for e in found
        if e["heading_level"] and e["region"] == "content"
    } == {"Regions": 1, "First": 2, "Under first": 3, "Second": 2, "Third": 2}
    regions = {e["text"]: e["region"] for e in found}
    assert regions["For the river, see elsewhere."] == "hatnote"
    assert regions["North South"] == "navbox"
    assert "toc" in set(regions.values())
    assert not [e for e in found if re.search(r"\bedit\b", e["text"])]
    tags = {e["tag"] for e in found}
    assert {"dl", "dt", "dd", "ol", "li", "blockquote", "pre", "p", "ul"} <= tags
    assert "a  b\n  c" in {e["text"] for e in found if e["tag"] == "pre"}
    by_id = {e["element_id"]: e for e in elements(run, "Regions")}
    items = [e for e in found if e["tag"] == "li" and e["text"] in ("one", "two")]
    assert [by_id[e["parent_id"]]["tag"] for e in items] == ["ol", "ol"]
    assert len({e["reading_order"] for e in by_id.values()}) == len(by_id)


def test_nothing_of_a_skin_is_content(mediawiki, programs, section, tmp_path):
    """A page has the same texts in each of MediaWiki's own skins."""
    hosts, origins = reach(mediawiki.url, ())
    start = partial(Browser, programs, hosts=hosts, origins=origins, user_agent="lorecrawl/test")
    look = partial(start, viewport=(1280, 1024), page_seconds=section.page_seconds)
    told = {}
    with Pool(partial(look, before=page.page_script("settle.js")), 70) as pool:
        for skin in ("vector", "vector-2022", "monobook", "minerva", "timeless"):
            url = f"{mediawiki.url}/wiki/Regions?useskin={skin}"
            show = partial(page.capture, url=url, shot=tmp_path / "shot.png", max_height=100_000)
            seen = pool.use(partial(show, rules=section.rules)).extraction["elements"]
            texts = [e for e in seen if e["kind"] in ("text", "cell") and e["region"] != "toc"]
            told[skin] = [(e["text"], e["level"]) for e in texts]
    assert told["vector"][0] == ("Regions", 1)
    assert all(texts == told["vector"] for texts in told.values()), told


def test_a_real_wiki_is_told_as_it_is_shown(data, mediawiki, programs):
    run, *_ = data
    check_against_a_browser(run, mediawiki.url, programs)


def test_boxes_of_a_tall_wiki_page_hold_their_colour(data):
    run, *_ = data
    (page,) = query(run, "SELECT * FROM pages WHERE title = 'Colours'")
    assert page["page_height"] > 20_000
    stripes = elements(run, "Colours", "text LIKE 'Stripe %'")
    assert len(stripes) == 40
    with Image.open(run.root / page["screenshot_path"]) as picture:
        for stripe in stripes:
            n = int(stripe["text"].split()[1])
            at = int(stripe["x"] + stripe["width"] - 4), int(stripe["y"] + stripe["height"] / 2)
            assert picture.getpixel(at) == (40 + 5 * n, 250 - 5 * n, (n * 53) % 256)


# Facts and recipes, as they were written: each infobox and recipe of a page differs from the first
# in one field or slot, and so must its rows.

IDS = ("page_id", "recipe_index", "fact_id", "element_id", "visible", "revision_id")


def workshop_rows(run, table):
    """What the workshop's page says, in its order."""
    order = "fact_id" if table == "facts" else "recipe_index, slot, alternative"
    found = f"SELECT t.* FROM {table} t JOIN pages p USING (page_id) WHERE title = 'Workshop'"
    return query(run, f"{found} ORDER BY {order}")


def bare(rows):
    return [{name: value for name, value in row.items() if name not in IDS} for row in rows]


def test_each_recipe_is_what_was_written_slot_for_slot(data):
    run, *_ = data
    written = list(workshop.recipes())
    rows = workshop_rows(run, "recipes")
    found = [bare(group) for _, group in groupby(rows, key=lambda row: row["recipe_index"])]
    assert len(found) == len(written) > 40
    for (slot, recipe), rows in zip(written, found, strict=True):
        assert rows == workshop.expected_recipe(recipe)
        differ = [row for row in rows if row not in found[0]]
        differ += [row for row in found[0] if row not in rows]
        assert {row["slot"] for row in differ} == ({slot} if slot is not None else set())


def test_each_infobox_is_what_was_written_field_for_field(data):
    run, *_ = data
    expected = [row for _, box in workshop.boxes() for row in workshop.expected_facts(box)]
    rows = workshop_rows(run, "facts")
    assert bare(rows) == expected
    assert [row["fact_id"] for row in rows] == list(range(len(expected)))


def test_facts_and_recipes_name_their_elements_and_revision(data):
    run, *_ = data
    (page,) = query(run, "SELECT revision_id FROM pages WHERE title = 'Workshop'")
    by_id = {row["element_id"]: row for row in elements(run, "Workshop")}
    facts, recipes = workshop_rows(run, "facts"), workshop_rows(run, "recipes")
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
    (other,) = query(
        run, "SELECT f.* FROM facts f JOIN pages USING (page_id) WHERE title = 'Pictures'"
    )
    assert bare([other]) == [{"subject": "Pictures", "field": "Weight", "value": "2", "unit": "kg"}]


def test_a_second_crawl_shows_only_what_changed(data, mediawiki):
    """Runs last: it changes the wiki."""
    run, *_ = data
    before = {
        row["title"]: row["page_id"] for row in query(run, "SELECT title, page_id FROM pages")
    }
    shown = sum(1 for _ in rawlog.envelopes(run.root, "wiki", "renders"))
    mediawiki.edit(
        "Grids",
        "The grid was taken down, and in its place there stands a plain paragraph that says"
        " so in more than twenty words of text, all told.",
    )
    mediawiki.edit(
        "Brand new",
        "A page that nobody has seen before, and that tells at some length of nothing in"
        " particular, in more than twenty words.",
    )
    old = bare(workshop_rows(run, "recipes"))
    first = list(workshop.BASE)
    first[4] = (workshop.Thing("Salt", 1), workshop.Thing("Sand", 2))
    mediawiki.edit("Workshop", workshop.text(tuple(first)))
    (mediawiki.folder / "moves.txt").write_text("To be moved|Has moved\n")
    mediawiki.php("moveBatch", str(mediawiki.folder / "moves.txt"))
    (mediawiki.folder / "gone.txt").write_text("To be deleted\n")
    mediawiki.php("deleteBatch", str(mediawiki.folder / "gone.txt"))
    drawn = mediawiki.folder / "redrawn"
    drawn.mkdir()
    Image.new("RGB", (333, 222), (1, 2, 3)).save(drawn / "Flat.png")
    mediawiki.php(
        "importImages", "--overwrite", "--comment", "redrawn", "--extensions", "png", str(drawn)
    )
    assert crawl(run)["crawled"] == 0
    again = crawl(dataclasses.replace(run, again=True))
    assert again["crawled"] == 4
    renders = [e.response["title"] for e in rawlog.envelopes(run.root, "wiki", "renders")][shown:]
    assert sorted(renders) == ["Brand new", "Grids", "Has moved", "Workshop"]
    run_clean(run, "wiki")
    # An edit of one slot changes the row of that slot.
    new = bare(workshop_rows(run, "recipes"))
    changed = [row for row, before in zip(new, old, strict=True) if row != before]
    assert [(row["slot"], row["item"], row["quantity"]) for row in changed] == [(4, "Sand", 2)]
    rows = {row["title"]: row for row in query(run, "SELECT * FROM pages")}
    assert "To be deleted" not in rows
    # A picture that was replaced under its name is fetched again, without showing its pages again.
    sizes = query(
        run,
        "SELECT DISTINCT i.width, i.height FROM images i JOIN pages p USING (page_id) WHERE"
        " src LIKE '%/Flat.png' AND title = 'Pictures'",
    )
    assert sizes == [{"width": 333, "height": 222}]
    assert "To be moved" not in rows
    assert rows["Has moved"]["page_id"] == before["To be moved"]
    assert not query(run, f"SELECT * FROM cells WHERE page_id = {before['Grids']}")
    assert tombstones.keys(run.root, "wiki") == {str(before["To be deleted"]), "To be moved"}
