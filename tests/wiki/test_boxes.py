"""Box against pixel: what a box names is what the screenshot shows there, on short pages and very
tall ones.
"""

from __future__ import annotations

import pytest
from PIL import Image

from kb.wiki.screenshot import snapped

COLOUR = {n: (40 + n % 200, 250 - n % 200, (n * 53) % 256) for n in range(400)}


def block(n: int, style: str) -> str:
    """A coloured box with its number as unseen text, so that the whole box has one colour."""
    rgb = ",".join(map(str, COLOUR[n]))
    return f'<p style="margin:3px 0;background:rgb({rgb});color:transparent;{style}">{n}</p>'


def check(found, expected: int) -> None:
    """Every visible text box holds its colour alone."""
    page = found.extraction["page"]
    with Image.open(found.picture) as image:
        assert image.size == (page["width"], page["height"])
        image.load()
        texts = [e for e in found.extraction["elements"] if e["tag"] == "p" and e["visible"]]
        assert len(texts) == expected
        for element in texts:
            left, top, right, bottom = snapped(element["box"])
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
        ' style="display:inline-block;width:16px;height:16px;background:url(/sheet.png) -16px 0"></span>'
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
