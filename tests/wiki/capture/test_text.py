"""What counts as a page's text: the content and nothing of the skin, what a reader sees or can
unfold, and characters that mean something.
"""

from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.wiki.parse import tables
from kb.wiki.parse.facts import MarkupRules
from kb.wiki.passages import sections

RULES = MarkupRules()


def seen(pages: Any, look: Any, body: str, name: str = "text", **options: Any) -> Any:
    html = f"<!DOCTYPE html><meta charset=utf-8><body>{body}"
    return look(pages.put(f"/as-shown/{name}", html), **options).extraction


def texts(extraction: Any) -> list[str]:
    return [e["text"] for e in extraction["elements"] if e["kind"] == "text"]


CONTENT = "<div class='mw-parser-output'><p>Words of the page.</p></div>"
SKINS = {
    "a main element around everything": f"""<main><div class="page-header">
      <div class="page-header__categories">in: <a>Tools</a></div>
      <h1 class="page-header__title" id="firstHeading">Kiln</h1><a class="edit">Edit</a></div>
      <div id="content"><div id="mw-content-text">{CONTENT}</div></div>
      <div class="ad-slot-placeholder">Advertisement</div>
      <div class="page-footer">Categories: Tools. CC BY-SA</div></main>""",
    "tools beside the title": f"""<div id="content"><header><h1 id="firstHeading">Kiln</h1>
      <nav>Share More actions Last edited on Monday</nav></header>
      <div id="bodyContent"><div id="mw-content-text">{CONTENT}</div></div></div>""",
    "tabs before the content": f"""<main id="content"><h1 id="firstHeading">Kiln</h1>
      <ul><li>Page</li><li>Discussion</li></ul><ul><li>Watch</li><li>History</li></ul>
      <div id="bodyContent"><div id="mw-content-text">{CONTENT}</div></div></main>""",
    "no parser output": """<div id="content"><h1 class="firstHeading">Kiln</h1>
      <div id="bodyContent">
      <h3 id="siteSub">From the wiki</h3><div id="contentSub">(Redirected)</div>
      <div id="jump-to-nav">Jump to</div><p>Words of the page.</p>
      <div class="printfooter">Retrieved from</div><div id="catlinks">Category: Tools</div>
      </div></div>""",
    "a notice that is parsed too": f"""<div id="siteNotice"><div class="mw-parser-output">Vote now
      </div></div><h1 id="firstHeading">Kiln</h1><div id="mw-content-text">{CONTENT}</div>""",
}


@pytest.mark.parametrize("skin", SKINS)
def test_nothing_of_a_skin_is_content(pages, look, skin):
    assert texts(seen(pages, look, SKINS[skin])) == ["Kiln", "Words of the page."]


def test_furniture_is_no_content(pages, look):
    links = (
        "<{0}><a href=/wiki/T>v</a> · <a href=/wiki/D>d</a> · <a href=/w?action=edit>b</a></{0}>"
    )
    body = f"""<div id=content><span class=subpages>&lt; <a>Kiln</a></span><p>Text</p>
      <div class="mw-pt-languages">Deutsch English</div>
      <table class=navbox><tr><th>{links.format("div")}Kilns</th></tr><tr><td>
      {links.format("small")} North</td></tr></table></div>"""
    extraction = seen(pages, look, body)
    assert texts(extraction) == ["Text"]
    assert [cell["text"] for cell in extraction["cells"]] == ["Kilns", "North"]


HIDDEN = {
    "clipped": "position:absolute;width:1px;height:1px;overflow:hidden;clip:rect(0,0,0,0)",
    "cut to nothing": "position:absolute;clip-path:inset(50%)",
    "off the screen": "position:absolute;left:-9999px",
    "indented away": "display:inline-block;width:9px;overflow:hidden;text-indent:-9999px",
    "of no size": "font-size:0",
    "transparent": "opacity:0",
    "of no colour": "color:transparent",
    "in a box of no height": "display:inline-block;height:0;overflow:hidden",
}


def test_words_that_nobody_sees_are_no_text_and_glue_none(pages, look):
    ways = "".join(
        f"""<p>Open<span style="{style}">for readers</span> {way}</p>
        <div style="{style}">Only for readers</div>"""
        for way, style in HIDDEN.items()
    )
    found = seen(pages, look, f"<div id=content>{ways}</div>")["elements"]
    assert [e["text"] for e in found if e["visible"]] == [f"Open {way}" for way in HIDDEN]
    assert not any(e["folded"] for e in found)


FOLDED = {
    "a tab": """<div role=tablist><a role=tab href="#two">Two</a></div>
      <section style="overflow:hidden;width:300px;display:flex">
      <div style="min-width:300px">One</div>
      <div role=tabpanel id=two style="min-width:300px"><p>{0}</p></div></section>""",
    "a tab of a class": '<div class="tabber-panel" style="display:none"><p>{0}</p></div>',
    "a controlled part": """<button aria-controls=part aria-expanded=false>More</button>
      <div id=part hidden><p>{0}</p></div>""",
    "a collapsed block": """<div class="mw-collapsible mw-collapsed">Head<div
      class="mw-collapsible-content" style="display:none"><p>{0}</p></div></div>""",
    "a custom toggle": """<a class="mw-customtoggle-x">Show</a>
      <div class="mw-collapsible mw-collapsed" id="mw-customcollapsible-x" style="display:none">
      <p>{0}</p></div>""",
    "a collapsed table": """<table class="wikitable mw-collapsed"><tr><th>Head</th></tr>
      <tr style="display:none"><td>{0}</td></tr></table>""",
    "closed details": "<details><summary>Head</summary><p>{0}</p></details>",
    "a section until found": '<div hidden="until-found"><p>{0}</p></div>',
    "a box that scrolls": """<div style="height:40px;overflow:auto"><p>Head</p>
      <p style="margin-top:300px">{0}</p></div>""",
    "a caption under the pointer": """<div class="gallery mw-gallery-packed-hover"><div
      class="gallerybox" style="position:relative"><div class="thumb"><img src="/none.png"></div>
      <div class="gallerytextwrapper" style="overflow:hidden;height:0"><div class="gallerytext">
      <p>{0}</p></div></div></div></div>""",
    "a caption that fades in": """<figure><img src="/none.png"><figcaption
      style="opacity:0">{0}</figcaption></figure>""",
    "an accordion of no height": """<div class="accordion-item"
      style="max-height:0;overflow:hidden"><p>{0}</p></div>""",
}


def test_what_a_page_offers_to_show_is_folded(pages, look):
    offered = "".join(
        part.format(f'Behind {way}<span style="display:none"> a key</span>')
        for way, part in FOLDED.items()
    )
    never = "".join(part.format("Never") for part in FOLDED.values())
    body = f"""<div id=content>{offered}<div style="display:none">{never}</div></div>"""
    extraction = seen(pages, look, body)
    rows = tables.elements(1, extraction["elements"], RULES).to_pylist()
    text = tables.page_text(extraction["elements"])
    lines = "\n".join(line for part in sections(rows, {}, {}) for line in part.lines)
    for way in FOLDED:
        (found,) = (e for e in extraction["elements"] if e["text"] == f"Behind {way}")
        assert (found["visible"], found["folded"], found["box"]) == (False, True, None), way
        assert text.splitlines().count(f"Behind {way}") == 1
        row = rows[found["id"]]
        assert (row["folded"], row["visible"], row["x"], row["lines"]) == (True, False, None, None)
        assert found["kind"] != "text" or f"Behind {way}" in lines
    assert all(not e["folded"] for e in extraction["elements"] if "Never" in (e["text"] or ""))
    assert "Never" not in text


CHARACTERS = [
    ("stone&#8203;cutter", "stonecutter"),
    ("re&shy;mark&#65279;able &lrm;word&#8288;s", "remarkable words"),
    ("a&#x202a;b&#x2069; c&#x180e;d", "ab cd"),
    ("می&zwnj;خواهم", "می\u200cخواهم"),
    ("क्&zwj;ष a&zwj;b&zwnj;", "क्\u200dष ab"),
    ("&#x1F468;&zwj;&#x1F469;", "\U0001f468\u200d\U0001f469"),
    ("in 10<sup>6</sup> years, 10<sup>−3</sup> m", "in 10^6 years, 10^−3 m"),
    ("the 1<sup>st</sup> kiln<sup class=reference>[2]</sup>.", "the 1st kiln."),
    ("kiln<sup class=note><a href='#cite_note-2'>[2]</a></sup>, pot", "kiln, pot"),
    ("jug<sup><i><a href='/wiki/Jug#cite_note-a-1'>a</a></i></sup>", "jug"),
    (
        "bowl<a href='#cite_note-3'><sup>3</sup></a> cup<sup><a href='#Notes'>b</a></sup>",
        "bowl cupb",
    ),
    ("<a href='#cite_note-3'>the third note</a>", "the third note"),
    ("<ruby>漢<rp>(</rp><rt>kan</rt><rp>)</rp></ruby>", "漢kan"),
    ("is <math><mi>x</mi><mo>+</mo><mn>1</mn></math> now", "is x+1 now"),
    ("one<span style='display:block'>two</span>three", "one\ntwo\nthree"),
]


def test_characters_and_separators(pages, look):
    body = "".join(f"<p>{html}</p>" for html, _ in CHARACTERS)
    found = texts(seen(pages, look, f"<div id=content>{body}</div>"))
    assert found == [text for _, text in CHARACTERS]


@pytest.mark.parametrize("shown", ["mathml", "picture"])
def test_the_text_of_a_formula_is_its_tex(pages, look, shown):
    tex = r"{\displaystyle E=mc^{2}}"
    hidden = ("", "display:none") if shown == "mathml" else ("display:none", "")
    body = f"""<div id=content><p>Heat is <span class="mwe-math-element">
      <span class="mwe-math-mathml-inline" style="{hidden[0]}"><math alttext="{tex}"><semantics>
      <mrow><mi>E</mi></mrow><annotation encoding="application/x-tex">{tex}</annotation>
      </semantics></math></span><img src="/none.svg" alt="{tex}" style="{hidden[1]}"
      class="mwe-math-fallback-image-inline"></span> at dawn.</p>
      <table><tr><td>1,250<sup class="reference">[2]</sup></td></tr></table></div>"""
    extraction = seen(pages, look, body)
    assert texts(extraction) == ["Heat is E=mc^{2} at dawn."]
    assert [cell["text"] for cell in extraction["cells"]] == ["1,250"]


def test_lines_of_vertical_text_stand_beside_each_other(pages, look):
    style = "writing-mode:vertical-rl;height:120px;font:20px/30px monospace;margin:0"
    body = f"<div id=content><p style='{style}'>one <b>two</b><br>three <small>four</small><br>five"
    (found,) = seen(pages, look, body)["elements"]
    assert len(found["lines"]) == 3
    assert all(height > width for _, _, width, height in found["lines"])
    left = [x for x, *_ in found["lines"]]
    assert left == sorted(left, reverse=True)


def test_captions_belong_to_one_picture(pages, look):
    img = '<img src="/as-shown/{}.png">'.format
    frame = '<div class="thumb"><div class="thumbinner">{}</div></div>'.format
    cap = '<div class="thumbcaption">{}</div>'.format
    single = '<div class="tsingle">{}</div>'.format
    infobox = '<aside class="portable-infobox"><figure>{}</figure></aside>'.format
    body = "".join(
        [
            frame(img("1") + cap(f"First {img('icon1')}")),
            frame(single(img("2") + cap("Left")) + single(img("3") + cap("Right"))),
            frame(img("4") + cap("Fourth") + img("5") + cap("Fifth")),
            frame(img("6") + img("7") + cap("All of them")),
            infobox(img("8") + "<figcaption>In the box</figcaption>"),
            f"""<ul class="gallery"><li class="gallerycaption">All</li><li class="gallerybox">
              <div class="thumb">{img("9")}</div><div class="gallerytext">In the row</div></li>
              <li class="gallerybox"><div class="thumb">{img("10")}</div></li></ul>""",
            f"<p>{img('11')}</p>",
        ]
    )
    found = seen(pages, look, f"<div id=content>{body}</div>")["elements"]
    captions = {
        e["src"].rpartition("/")[2].removesuffix(".png"): e["caption"]
        for e in found
        if e["kind"] == "image"
    }
    assert captions == {
        "1": "First",
        "icon1": None,
        "2": "Left",
        "3": "Right",
        "4": "Fourth",
        "5": "Fifth",
        "6": None,
        "7": None,
        "8": "In the box",
        "9": "In the row",
        "10": None,
        "11": None,
    }


def test_headings_of_an_infobox_are_no_sections(pages, look):
    body = """<div id=content><aside class="portable-infobox"><h2 class="pi-title">Kiln</h2>
      <section><h3 class="pi-header">Heat</h3><div>700</div></section></aside>
      <p>The lead.</p><h2>Uses</h2><p>Of it.</p></div>"""
    extraction = seen(pages, look, body)
    rows = tables.elements(1, extraction["elements"], RULES).to_pylist()
    found = {section.path: section.lines for section in sections(rows, {}, {})}
    assert found.keys() == {"", "Uses"}
    assert found[""][-1] == "The lead."


def test_a_profile_names_roots_in_order_of_preference():
    rules = load_profile("minecraft").wiki.rules
    markup = load_profile("minecraft").wiki.markup.model_copy(update={"root": "a:is(b, c), d"})
    assert rules["root"][0] == "#mw-content-text .mw-parser-output"
    other = load_profile("minecraft").wiki.model_copy(update={"markup": markup})
    assert other.rules["root"] == ["a:is(b, c)", "d"]
