"""Wiki pages as Markdown: fidelity to what a reader sees, by another reading, and its forms."""

import json
from collections import Counter
from functools import partial
from typing import Any

import duckdb
import pytest

from kb.core.config.profile import load_profile
from kb.wiki.browser.browser import Browser, Pool, reach
from kb.wiki.markdown import PageText
from kb.wiki.parse import facts, graph, tables
from kb.wiki.parse.facts import MarkupRules
from tests.recipes import export
from tests.wiki.shown_words import READ, compared, words


def texts_of(run: Any) -> dict[str, Any]:
    export(run, "wiki", "text")
    lines = (run.root / "export/text/wiki.jsonl").read_text(encoding="utf-8").splitlines()
    return {one["metadata"]["url"]: one for one in map(json.loads, lines)}


def named_or_folded(run: Any) -> Counter[str]:
    found: Counter[str] = Counter()
    for name, texts in (
        ("recipes", "item || ' ' || quantity"),
        ("elements", "CASE WHEN folded OR kind = 'sprite' THEN text END"),
    ):
        path = f"{run.root}/clean/wiki/{name}/*.parquet"
        for (text,) in duckdb.sql(f"SELECT {texts} FROM read_parquet('{path}')").fetchall():
            found.update(words(text or ""))
    return found


def check_against_a_browser(run: Any, url: str, programs: Any) -> None:
    """At least 99.5 % of the words of all pages in order and all tables. No word is there more
    often, but for names in recipes and of icons, and what is folded.
    """
    hosts, origins = reach(url, ())
    start = partial(
        Browser,
        programs,
        hosts=hosts,
        origins=origins,
        user_agent="reader",
        viewport=(1280, 1024),
        page_seconds=60,
        before="",
    )
    shown = told = 0
    often: Counter[str] = Counter()
    with Pool(start, 120) as pool:
        for address, document in texts_of(run).items():

            def read(browser: Browser, address: str = address) -> Any:
                browser.go(address)
                return browser.script(READ)

            seen = pool.use(read)
            of_page, found, extra, tables = compared(seen, document["text"])
            assert not tables, (address, tables, document["text"])
            shown, told = shown + of_page, told + found
            often += extra
    assert told >= 0.995 * shown
    assert not often - named_or_folded(run), often


PAGE = {"page_id": 1, "title": "Kiln", "revision_id": 1}
RULES = MarkupRules(item=load_profile("minecraft").wiki.markup.item)


def markdown(extraction: Any) -> str:
    """Of what was captured, by way of the tables."""
    rows = {
        "elements": tables.elements(1, extraction["elements"], RULES).to_pylist(),
        "cells": tables.cells(1, extraction["cells"]).to_pylist(),
        "facts": facts.facts(PAGE, extraction["facts"], RULES),
        "recipes": facts.recipes(PAGE, extraction["recipes"], RULES),
    }
    return "\n\n".join(PageText(**rows).blocks())


SLOT = '<span class="invslot"><img alt="{}" src="/none.png">{}</span>'.format
FORMS = {
    "lists": (
        """<ul><li>one <a href="/wiki/Fire_pit">a pit</a><ol><li>deep</li><li>deeper
        <ul><li>deepest</li></ul></li></ol>after</li><li>two</li></ul>
        <dl><dt>Ash</dt><dd>what is left</dd></dl>""",
        (
            "- one [a pit](<Fire pit>)\n  1. deep\n  2. deeper\n     - deepest\n  after\n- two\n\n"
            "- Ash\n  - what is left"
        ),
    ),
    "links": (
        """<p>To <a href="/wiki/Kiln_(old)">kilns</a>, <a href="/w/index.php?title=Slip&x=1">x</a>,
        <a href="/wiki/Gone" class="new">gone</a>, <a href="#Uses">here</a>,
        <a href="https://elsewhere.example/wiki/Ash">ash</a>,
        <a href="/wiki/%C3%96l">Öl</a>.</p>""",
        "To [kilns](<Kiln (old)>), [x](Slip), gone, here, ash, [Öl](Öl).",
    ),
    "icons": (
        """<p>Take <span class="sprite-file"><img alt="Clay" src="/none.png"></span> clay and
        <span class="sprite-file"><img alt="Ash" src="/none.png"></span>, <b>then</b> burn.</p>
        <table><tr><th>What</th><th>Why</th></tr><tr><td><span class="sprite-file"><img alt="Salt"
        src="/none.png"></span></td><td>a|b <a href="/wiki/Ash">ash</a></td></tr></table>""",
        (
            "Take clay and Ash, then burn.\n\n"
            "| What | Why |\n| --- | --- |\n| Salt | a\\|b [ash](Ash) |"
        ),
    ),
    "spans": (
        """<table><caption>Heat</caption><tr><th rowspan=2>Kiln<th colspan=2>Low<tr><td>1
        <table><tr><td>in</table><td>2<tr hidden><td>no<td>no<td>no</table>""",
        "Heat\n\n| Kiln | Low | Low |\n| --- | --- | --- |\n| Kiln | 1 | 2 |\n\n| in |\n| --- |",
    ),
    "a box without a table": (
        """<aside class="portable-infobox"><h2 class="pi-title">Tall jar</h2>
        <figure><img src="/none.png"><figcaption>In use</figcaption></figure>
        <section class="pi-group"><h2 class="pi-header">Sizes</h2><div class="pi-data">
        <h3 class="pi-data-label">Weight</h3><div class="pi-data-value">2 kg</div></div></section>
        </aside><p>The lead.</p>""",
        (
            "| Tall jar |  |\n| --- | --- |\n| In use |  |\n| Sizes |  |\n| Weight | 2 kg |\n\n"
            "The lead."
        ),
    ),
    "a recipe": (
        f"""<div class="mcui"><span class="mcui-input"><span class="mcui-row">{SLOT("Clay", "")}
        {SLOT("Ash", '<span class="invslot-stacksize">2</span>')}</span></span>
        <span class="mcui-output">{SLOT("Jar", '<span class="invslot-stacksize">4</span>')}</span>
        </div>""",
        "| Clay | Ash ×2 |\n| --- | --- |\n\n→ Jar ×4",
    ),
    "left out": (
        """<div id="toc">1 First</div><p style="display:none">never</p><h2>First
        <span class="mw-editsection">edit</span></h2><div class="mw-collapsible-content"
        style="display:none"><p>folded</p></div><p># no heading</p><pre>a  b\n # c</pre>
        <blockquote>said</blockquote><table class="navbox"><tr><td>North</table>""",
        "## First\n\nfolded\n\n\\# no heading\n\n```\na  b\n # c\n```\n\n> said",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_markdown_of_what_a_page_is_made_of(pages, look, form):
    html, expected = FORMS[form]
    conf = '<script>RLCONF={"wgPageName":"Kiln"}</script>'
    page = f"<!DOCTYPE html><meta charset=utf-8>{conf}<div id=content><h1>Kiln</h1>{html}</div>"
    assert markdown(look(pages.put("/wiki/Kiln", page)).extraction) == expected


def test_links_of_a_page_are_listed_with_those_to_pages_that_are_not_there(pages, look):
    html = f"<h2>Uses</h2>{FORMS['links'][0]}<ul><li><a href='/wiki/Slip'>x</a></li></ul>"
    conf = '<script>RLCONF={"wgPageName":"Kiln"}</script>'
    page = f"<!DOCTYPE html><meta charset=utf-8>{conf}<div id=content><h1>Kiln</h1>{html}</div>"
    extraction = look(pages.put("/wiki/Kiln", page)).extraction
    rows = list(graph.page_links(1, extraction["elements"]))
    assert {(row["target_title"], row["text"], row["count"]) for row in rows} == {
        ("Kiln (old)", "kilns", 1),
        ("Slip", "x", 2),
        ("Gone", "gone", 1),
        ("Öl", "Öl", 1),
    }
    assert {(row["section"], row["region"]) for row in rows} == {("Uses", "content")}
