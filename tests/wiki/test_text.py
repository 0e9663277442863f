"""Wiki pages as Markdown: fidelity to what a reader sees, by another reading, and its forms."""

import json
import re
from collections import Counter
from difflib import SequenceMatcher
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

# What a reader sees, read by the browser alone: the words of `innerText`, and the grid of each
# table, without boxes of links, contents, tools, marks of footnotes, and what is put where nobody
# sees it.
READ = r"""
const style = document.createElement("style");
style.textContent = `.navbox, #toc, .toc, .mw-editsection, .mw-jump-link, #siteSub, #contentSub,
  .printfooter, .catlinks, .vector-toc, .mw-empty-elt, sup.reference, noscript
  { display: none !important }
  * { text-transform: none !important }`;
document.head.append(style);
const root = document.querySelector("#mw-content-text .mw-parser-output")
  || document.querySelector("#mw-content-text") || document.querySelector("main") || document.body;
const title = document.querySelector("#firstHeading");
for (const e of root.querySelectorAll("*")) {
  const box = e.getBoundingClientRect(), s = getComputedStyle(e);
  if (box.right < 0 || s.overflow === "hidden" && box.height === 0) e.style.display = "none";
}
const seen = (e) => e.checkVisibility() && !e.closest(".navbox, #toc, .toc");
const tables = [...root.querySelectorAll("table")].filter(seen).map((table) =>
  [...table.rows].map((row) => [...row.cells].map((cell) => {
    const inner = [...cell.querySelectorAll("table")];
    inner.forEach((one) => { one.style.display = "none"; });
    const words = cell.innerText;
    inner.forEach((one) => { one.style.display = ""; });
    return [words, cell.rowSpan, cell.colSpan];
  })));
const head = title && !root.contains(title) ? title.innerText + "\n" : "";
return { text: head + root.innerText, tables };
"""
Grid = list[list[str]]


def laid_out(rows: list[list[tuple[str, int, int]]]) -> tuple[Grid, set[tuple[int, int]]]:
    """The words of a table in every place that a cell covers, and the places where cells begin."""
    places: dict[tuple[int, int], str] = {}
    begun = set()
    for r, row in enumerate(rows):
        c = 0
        for words, down, across in row:
            while (r, c) in places:
                c += 1
            begun.add((r, c))
            for i in range(r, min(r + (down or len(rows)), len(rows))):
                for j in range(c, c + across):
                    places[i, j] = " ".join(words.split())
            c += across
    width = max((c + 1 for r, c in begun), default=0)
    return [[places.get((r, c), "") for c in range(width)] for r in range(len(rows))], begun


def blocks(markdown: str) -> list[str | Grid]:
    """A Markdown text as its tables and what stands between them."""
    found: list[str | Grid] = []
    for line in markdown.split("\n"):
        if not line.startswith("|"):
            if not found or not isinstance(found[-1], str):
                found.append("")
            found[-1] += f"{line}\n"
            continue
        cells = [one.strip().replace("\\|", "|") for one in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not found or isinstance(found[-1], str):
            found.append([])
        found[-1].append([bare(one) for one in cells])
    for one in found:
        if not isinstance(one, str):
            assert {len(row) for row in one} == {len(one[0])}
            assert set(one.pop(1)) == {"---"}
    return found


def bare(markdown: str) -> str:
    """Without the marks of links, lists and headings."""
    text = re.sub(r"\[((?:[^\[\]\\]|\\.)*)\]\((?:<[^<>\n]*>|[^()\s]*)\)", r"\1", markdown)
    text = re.sub(r"^\s*(?:>\s|#{1,6}\s|(?:[-*]|\d+\.)(?:\s|$))+", "", text, flags=re.MULTILINE)
    return re.sub(r"\\(?=[#>|\[\]+*=`~-])", "", text)


def compared(seen: dict[str, Any], markdown: str) -> tuple[int, int, Counter[str], list[Grid]]:
    """The words that a reader sees, those of them that the Markdown has in their order, what it has
    more often, and tables that it has not in their order. A spanned cell's words count once, and
    those of tables that are none on the page (recipes, infoboxes) as they are.
    """
    grids = [laid_out(rows) for rows in seen["tables"]]
    missing = [grid for grid, _ in grids if any(map(any, grid))]
    told: list[str] = []
    for one in blocks(markdown):
        if isinstance(one, str):
            told += words(bare(one))
            continue
        begun = None
        for grid, places in grids:
            if missing and grid == missing[0] == one:
                begun = places
        if begun is not None:
            missing.pop(0)
        for r, row in enumerate(one):
            for c, cell in enumerate(row):
                if begun is None or (r, c) in begun:
                    told += words(cell)
    shown = words(seen["text"])
    same = SequenceMatcher(None, shown, told, autojunk=False).get_matching_blocks()
    return len(shown), sum(one.size for one in same), Counter(told) - Counter(shown), missing


def words(text: str) -> list[str]:
    return re.findall(r"\w+", text)


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
