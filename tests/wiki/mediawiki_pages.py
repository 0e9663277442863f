"""Own-written pages of an invented valley of kilns, each for a point of the crawl; given under CC0
1.0.
"""

from pathlib import Path

from PIL import Image, ImageDraw

from tests.wiki import infobox_page as workshop

COLOURS = [(200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40)]

CSS = """
.sprite { display: inline-block; width: 16px; height: 16px;
  background-image: url(/images/sheet.png); background-repeat: no-repeat; }
.animated > * { display: none; } .animated > .animated-active { display: block; }
.invslot { display: inline-block; width: 36px; height: 36px; background: #8b8b8b; }
.mcui { display: inline-block; } .mcui-row { display: block; }
.portable-infobox { width: 240px; }
.infobox { float: right; width: 240px; border: 1px solid #999; }
.navbox { width: 100%; clear: both; }
.wikitable { border-collapse: collapse; }
.wikitable td, .wikitable th { border: 1px solid #aaa; padding: 3px; }
"""
SCRIPT = """
setInterval( function () {
  document.querySelectorAll( '.animated' ).forEach( function ( slot ) {
    var now = slot.querySelector( ':scope > .animated-active' ),
      next = now.nextElementSibling || slot.firstElementChild;
    now.classList.remove( 'animated-active' ); next.classList.add( 'animated-active' );
  } );
}, 1500 );
"""
FILLER = (
    "The kilns of the valley burn from the first frost to the thaw, and every potter"
    " keeps a book of firings, in which the wood is counted. "
)

PAGES = {
    "MediaWiki:Common.css": CSS,
    "MediaWiki:Common.js": SCRIPT,
    "Main Page": f"Welcome to the valley. {FILLER}\n* [[Grids]]\n* [[Pictures]]\n",
    "Grids": FILLER
    + """
{| class="wikitable"
|+ Firings
! rowspan="2" | Kiln !! colspan="2" | Heat
|-
! Low !! High
|-
| North || rowspan="9" | 700 || 900
|-
| South || colspan="40" | 950
|}
{| class="wikitable"
! Outer !! Inner
|-
| before
{| class="wikitable"
| deep one || deep two
|}
after
| plain
|}
""",
    "Pictures": FILLER
    + """
[[File:Tall.png|thumb|60px|alt=A tall jar|The ''tall'' jar.]]
[[File:Flat.png|frame|none|The flat dish.]]
<gallery>
Tall.png|In the gallery
Flat.png|alt=Dish seen from above|The dish again
</gallery>
<table class="infobox"><tr><td colspan="2">[[File:Flat.png|100px|alt=Boxed]]\
<div class="infobox-caption">Dish in the box</div></td></tr>
<tr><th>Weight</th><td>2 kg</td></tr></table>
""",
    "Frames": FILLER
    + """
[[File:Blink.gif|none|frame|Three colours.]]
[[File:Spin.png|none|frame|Two turns.]]
<div class="mcui"><span class="invslot animated">\
<span class="animated-active">[[File:Flat.png|16px|link=]]</span>\
<span>[[File:Tall.png|16px|link=]]</span>\
<span>[[File:Flat.png|16px|link=|alt=again]]</span></span></div>
""",
    "Icons": FILLER
    + """
Take <span class="sprite-file">[[File:Dot.png|16px|link=|alt=Clay]]</span> clay, and \
<span class="sprite" title="Ash" style="background-position:-16px 0"></span> ash,
and <span class="sprite" title="Salt" style="background-position:0 -16px"></span> salt.
""",
    "Hidden": FILLER
    + """
<div style="display:none">Nobody sees this line of text.</div>
<div style="height:0; overflow:hidden"><p>Nor what is folded away here.</p></div>
<p style="position:absolute; left:-9999px">Nor what stands beside the page.</p>
Bare text stands without a paragraph<div>and another in a box.</div>
""",
    "Regions": """<div class="hatnote">For the river, see elsewhere.</div>
"""
    + FILLER
    + """
== First ==
; Glaze : a skin of glass
# one
# two
<blockquote>Said the potter.</blockquote>
<pre>
a  b
  c
</pre>
=== Under first ===
"""
    + FILLER
    + """
== Second ==
text [[Main Page]]
== Third ==
text
<table class="navbox"><tr><th>Kilns</th><td>North South</td></tr></table>
""",
    "Colours": FILLER
    + "\n"
    + "".join(
        f'<p style="margin:0;height:600px;background:rgb('
        f'{40 + 5 * n},{250 - 5 * n},{(n * 53) % 256})">'
        f"Stripe {n}</p>\n"
        for n in range(40)
    ),
    "Stub": "Too short.",
    # Images whose address is the page's own, and one that is not there.
    "Empty images": FILLER
    + """
<html><img src="" alt="empty"><img src="#" alt="part"><img alt="none"><img src="/images/gone.png">
<img src="?" alt="query"><img src="/wiki/Empty_images" alt="self"></html>
""",
    "To be moved": "This page goes elsewhere. " + FILLER,
    "To be deleted": "This page is thrown away. " + FILLER,
    "Öfen & 窯 (100%)": "A name full of traps. " + FILLER,
    "Old name": "#REDIRECT [[Grids]]",
    "Workshop": workshop.text(),
    **workshop.TEMPLATES,
}


def draw(folder: Path) -> None:
    """The pictures, drawn."""
    folder.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (120, 400), (120, 90, 60)).save(folder / "Tall.png")
    Image.new("RGB", (300, 200), (60, 120, 90)).save(folder / "Flat.png")
    Image.new("RGB", (16, 16), (250, 10, 120)).save(folder / "Dot.png")
    frames = [Image.new("RGB", (64, 64), colour) for colour in COLOURS]
    frames[0].save(
        folder / "Blink.gif",
        save_all=True,
        append_images=frames[1:3],
        duration=[300, 200, 100],
        loop=0,
    )
    frames[0].save(
        folder / "Spin.png", save_all=True, append_images=frames[1:2], duration=[500, 250], loop=0
    )
    sheet = Image.new("RGB", (32, 32))
    for number, colour in enumerate(COLOURS):
        x, y = number % 2 * 16, number // 2 * 16
        ImageDraw.Draw(sheet).rectangle((x, y, x + 15, y + 15), fill=colour)
    sheet.save(folder / "sheet.png")
