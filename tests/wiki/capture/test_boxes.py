"""Box against pixel: what a box names is what the screenshot shows there, on short pages and very
tall ones.
"""

import pytest
from PIL import Image

from kb.wiki.capture.screenshot import pixel_box

COLOUR = {n: (40 + n % 200, 250 - n % 200, (n * 53) % 256) for n in range(400)}


def block(n: int, style: str) -> str:
    """A coloured box that has one colour: of its number not even the shadow is painted."""
    rgb = ",".join(map(str, COLOUR[n]))
    unpainted = "color:transparent;text-shadow:0 0 transparent"
    return f'<p style="margin:3px 0;background:rgb({rgb});{unpainted};{style}">{n}</p>'


def check(found, expected: int) -> None:
    """Every visible text box holds its colour alone."""
    page = found.extraction["page"]
    with Image.open(found.picture) as image:
        assert image.size == (page["width"], page["height"])
        image.load()
        texts = [e for e in found.extraction["elements"] if e["tag"] == "p" and e["visible"]]
        assert len(texts) == expected
        for element in texts:
            left, top, right, bottom = pixel_box(element["box"])
            inner = image.crop((left + 1, top + 1, right - 1, bottom - 1))
            assert inner.getcolors(4) == [
                (inner.width * inner.height, COLOUR[int(element["text"])])
            ], element


@pytest.mark.parametrize(("name", "count", "height"), [("short", 4, 50.5), ("tall", 60, 380)])
def test_boxes_hold_their_colour(pages, look, name, count, height):
    body = "".join(block(n, f"height:{height}px;width:{300 + n}px") for n in range(count))
    found = look(
        pages.put(
            f"/boxes/{name}",
            f"<!DOCTYPE html><body style='margin:7.3px'><div id=content>{body}</div>",
        )
    )
    check(found, count)
    assert (found.extraction["page"]["height"] > 20_000) == (name != "short")


def test_boxes_of_moved_and_fixed_things(pages, look):
    """Fixed bars do not repeat over the tiles, sticky and transformed things stay where their box
    says.
    """
    body = (
        block(1, "position:fixed;bottom:0;height:40px;width:300px")
        + block(2, "position:sticky;top:0;height:30px;width:200px")
        + block(3, "height:30px;width:200px;transform:translate(200px,5px)")
        + block(4, "height:9000px;width:100px;animation:grow 1s infinite")
    )
    style = (
        "<style>@keyframes grow { from { margin-left: 600px } to { margin-left: 900px } }</style>"
    )
    found = look(
        pages.put(
            "/boxes/moved",
            f"<!DOCTYPE html>{style}<body style='margin:0'><div id=content>{body}</div>",
        )
    )
    check(found, 4)


def test_wide_page_is_pictured_whole(pages, look):
    body = block(1, "height:30px;width:2400px") + block(
        2, "height:30px;width:200px;position:relative;left:2100px"
    )
    found = look(
        pages.put(
            "/boxes/wide", f"<!DOCTYPE html><body style='margin:0'><div id=content>{body}</div>"
        )
    )
    assert found.extraction["page"]["width"] == 2400
    assert found.extraction["page"]["viewport_width"] == 1280
    check(found, 2)


def test_what_a_container_cuts_off_is_cut_off_the_box(pages, look):
    inner = block(1, "height:500px;width:900px;margin:0") + block(2, "height:40px;margin:0")
    found = look(
        pages.put(
            "/boxes/cut",
            "<!DOCTYPE html><body style='margin:0'><div id=content><div"
            f" style='width:300px;height:200px;overflow:hidden'>{inner}</div></div>",
        )
    )
    check(found, 1)
    first, second = (e for e in found.extraction["elements"] if e["tag"] == "p")
    assert first["box"] == [0, 0, 300, 200]
    assert not second["visible"]


def test_css_sprites_are_cropped_pixel_for_pixel(pages, look, tmp_path):
    sheet = Image.new("RGB", (32, 16), (10, 200, 30))
    sheet.paste((200, 20, 220), (16, 0, 32, 16))
    held = tmp_path / "sheet.png"
    sheet.save(held)
    pages.put("/sheet.png", held.read_bytes(), "image/png")
    far = '<div style="height:5000px">x</div>'
    icon = (
        '<span class="sprite" title="Ore"'
        ' style="display:inline-block;width:16px;height:16px;'
        'background:url(/sheet.png) -16px 0"></span>'
    )
    found = look(
        pages.put(
            "/boxes/sprites",
            f"<!DOCTYPE html><body style='margin:0'><div id=content><p>{icon}"
            f" ore</p>{far}<p>{icon}</p></div>",
        )
    )
    sprites = [e for e in found.extraction["elements"] if e["kind"] == "sprite"]
    assert [e["text"] for e in sprites] == ["Ore", "Ore"]
    assert len(found.sprites) == 2
    for data in found.sprites.values():
        (tmp_path / "crop.png").write_bytes(data)
        with Image.open(tmp_path / "crop.png") as crop:
            assert crop.size == (16, 16)
            assert crop.getcolors() == [(256, (200, 20, 220))]


def show(pages, look, name: str, body: str):
    """A page of that body: (what was captured, its text elements)."""
    found = look(
        pages.put(
            f"/lines/{name}",
            "<!DOCTYPE html><body style='margin:0;font:16px/20px sans-serif'>"
            f"<div id=content>{body}</div>",
        )
    )
    return found, [e for e in found.extraction["elements"] if e["kind"] == "text"]


def meet(one, other) -> bool:
    """Whether two boxes have an area in common."""
    return all(
        max(one[side], other[side]) < min(one[side] + one[side + 2], other[side] + other[side + 2])
        for side in (0, 1)
    )


def test_lines_of_a_paragraph_leave_out_what_floats_beside_it(pages, look):
    """The block's box covers the infobox, its lines don't: by box and by pixel."""
    box = (
        '<div style="float:right;width:300px;height:90px;background:#f00;color:#f00"'
        ' class="infobox">box</div>'
    )
    words = (
        "The kiln burns from the <b>first</b> frost<sup style='line-height:0'>1</sup>"
        " to <i>the</i> thaw. " * 20
    )
    found, texts = show(pages, look, "float", f'{box}<p style="margin:0">{words}</p>')
    (paragraph,) = (e for e in texts if e["tag"] == "p")
    held = [1280 - 300, 0, 300, 90]
    lines = paragraph["lines"]
    assert meet(paragraph["box"], held)
    assert not [line for line in lines if meet(line, held)]
    beside = [line for line in lines if line[1] + line[3] / 2 < 90]
    assert len(beside) >= 4
    assert max(line[2] for line in beside) <= 980 < max(line[2] for line in lines)
    tops = [line[1] for line in lines]
    assert tops == sorted(set(tops))
    assert len(lines) == round(paragraph["box"][3] / 20)
    with Image.open(found.picture) as image:
        for line in lines:
            left, top, right, bottom = pixel_box(line)
            colours = image.convert("RGB").crop((left, top, right, bottom)).getcolors(4096)
            assert (255, 0, 0) not in {colour for _, colour in colours}
            assert len(colours) > 1, "there are letters in it"


def test_lines_hold_what_is_shown_of_a_text_and_no_more(pages, look):
    """Neither edit links, hidden words nor tables; what a container cuts off is cut off."""
    body = (
        '<h2>Short<span class="mw-editsection"> [edit this section]</span></h2>'
        '<p>one<br>two<span style="display:none"> and much more of it</span></p>'
        '<div style="width:60px;height:30px;overflow:hidden"><p>cutoffcutoffcutoff</p></div>'
        '<p style="display:none">never shown</p>'
        "<ul><li>first</li><li>second<ul><li>inner</li></ul></li></ul>"
        '<p style="columns:2;orphans:1;widows:1;width:600px;margin:0">left<br>right</p>'
        '<p><span style="float:right">far</span>near</p>'
    )
    _, texts = show(pages, look, "shown", body)
    by_text = {e["text"]: e["lines"] for e in texts}
    ((_, _, heading, _),) = by_text["Short"]
    assert heading < 100
    assert [line[2] < 60 for line in by_text["one\ntwo"]] == [True, True]
    ((left, _, width, _),) = by_text["cutoffcutoffcutoff"]
    assert (left, width) == (0, 60)
    assert by_text["never shown"] is None
    assert by_text["first\nsecond\ninner"] == [*by_text["first"], *by_text["second\ninner"]]
    assert by_text["second\ninner"][1:] == by_text["inner"]
    assert len(by_text["left\nright"]) == 2
    assert sorted(line[0] > 300 for line in by_text["left\nright"]) == [False, True]
    assert sorted(line[0] > 600 for line in by_text["far\nnear"]) == [False, True]


def test_other_kinds_have_no_lines(pages, look):
    found, _ = show(pages, look, "kinds", "<table><tr><td>cell<p>text</p></td></tr></table>")
    held = {e["kind"]: e.get("lines") for e in found.extraction["elements"]}
    assert held["table"] is None
    assert held["cell"] is None
    assert len(held["text"]) == 1
