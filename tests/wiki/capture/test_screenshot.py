"""Screenshots: tiles are decoded, checked, joined to one PNG and cropped."""

import base64
import io

import pytest
from PIL import Image

from kb.core.errors import Retryable
from kb.wiki.capture import screenshot
from kb.wiki.capture.screenshot import PngWriter, decode_tile, encode_png


@pytest.fixture(scope="module")
def tall_image():
    """An image of many rows, with stretches of one colour."""
    image = Image.effect_noise((40, 3_000), 60).convert("RGB")
    for top, bottom in ((0, 40), (290, 331), (650, 1_500), (2_100, 2_110), (2_900, 3_000)):
        image.paste((top % 256, 200, 9), (0, top, 40, bottom))
    return image


@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
@pytest.mark.parametrize("cuts", [range(0, 3_000, 700), (0, 1, 2, 300), (0,)])
def test_tiles_are_joined(tall_image, tmp_path, mode, cuts):
    with PngWriter(tmp_path / "a.png", 40, 3_000) as png:
        for top, end in zip(cuts, (*cuts[1:], 3_000), strict=True):
            tile = tall_image.crop((0, top, 40, end))
            png.add_tile(decode_tile(encode_png(tile.convert(mode)), 40, tile.height))
    with Image.open(tmp_path / "a.png") as image:
        assert image.tobytes() == tall_image.tobytes()


@pytest.mark.parametrize("size", [(4, 8), (5, 9)])
def test_an_image_of_another_size_is_refused(tmp_path, size):
    with (
        pytest.raises(Retryable, match="screenshot_size"),
        PngWriter(tmp_path / "x.png", 4, 9) as png,
    ):
        png.add_tile(Image.new("RGB", size))


def test_a_damaged_tile_is_captured_again(tall_image):
    good, short = (encode_png(tall_image.crop((0, 0, 40, rows))) for rows in (30, 29))
    cut = [good[:20], good[:60], good[:33], good.replace(b"IDAT", b"IDAX"), b"<html>", b""]
    for data in (*cut, short):
        with pytest.raises(Retryable, match="screenshot_"):
            decode_tile(data, 40, 30)


class Repeating:
    """A browser whose graphics path starts again from the top after `limit` px, as a real one was
    seen to do.
    """

    def __init__(self, limit: int) -> None:
        self.page = Image.effect_noise((20, 3 * screenshot.TILE), 90).convert("RGB")
        self.limit, self.pictures = limit, 0

    def devtools(self, command, params):
        clip = params["clip"]
        self.pictures += 1
        rows = [
            (clip["y"] + n) % self.limit if clip["height"] > screenshot.STRIP else clip["y"] + n
            for n in range(clip["height"])
        ]
        image = Image.new("RGB", (clip["width"], clip["height"]))
        start = rows[0]
        image.paste(self.page.crop((0, start, clip["width"], start + clip["height"])), (0, 0))
        return {"data": base64.b64encode(encode_png(image)).decode()}


def test_repeated_tiles_are_found(tmp_path):
    good, bad = Repeating(10**9), Repeating(2 * screenshot.TILE)
    seam = {7: (3, screenshot.TILE - 900, 12, screenshot.TILE + 90), 8: (0, 0, 0, 5)}
    pieces = screenshot.take_screenshot(good, tmp_path / "a.png", 20, 3 * screenshot.TILE, seam)
    assert Image.open(tmp_path / "a.png").tobytes() == good.page.tobytes()
    assert list(pieces) == [7]
    assert Image.open(io.BytesIO(pieces[7])).tobytes() == good.page.crop(seam[7]).tobytes()
    assert good.pictures == screenshot.count_tiles(3 * screenshot.TILE) == 4
    with pytest.raises(Retryable, match="screenshot_repeats"):
        screenshot.take_screenshot(bad, tmp_path / "b.png", 20, 3 * screenshot.TILE)


class Blanking(Repeating):
    """A browser that leaves the end of a large picture white."""

    def devtools(self, command, params):
        answer = super().devtools(command, params)
        image = Image.open(io.BytesIO(base64.b64decode(answer["data"]))).convert("RGB")
        image.paste((255, 255, 255), (0, self.limit, *image.size))
        return {"data": base64.b64encode(encode_png(image)).decode()}


@pytest.mark.parametrize("height", [2, 3])
def test_blank_ends_of_tiles_are_found(tmp_path, height):
    bad = Blanking(screenshot.TILE - 9)
    with pytest.raises(Retryable, match="screenshot_repeats"):
        screenshot.take_screenshot(bad, tmp_path / "a.png", 20, height * screenshot.TILE)
