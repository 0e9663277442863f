"""Media types by bytes, sizes by headers, frames within limits; tall PNGs in bounded memory."""

from __future__ import annotations

import base64
import io
import zlib

import pytest
from PIL import Image

from kb.core.errors import Retryable
from kb.wiki.capture import screenshot
from kb.wiki.capture.images import inspect, media_type
from kb.wiki.capture.png import PixelRows, PngWriter


def picture(kind: str, size=(8, 6), frames: int = 1, **options) -> bytes:
    held = io.BytesIO()
    images = [Image.new("RGB", size, (n * 40, 20, 99)) for n in range(frames)]
    images[0].save(held, kind, save_all=frames > 1, append_images=images[1:], **options)
    return held.getvalue()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (picture("PNG"), ("image/png", 8, 6, ())),
        (picture("JPEG"), ("image/jpeg", 8, 6, ())),
        (picture("WEBP"), ("image/webp", 8, 6, ())),
        (picture("GIF"), ("image/gif", 8, 6, ())),
        (picture("GIF", frames=3, duration=[100, 200, 300]), ("image/gif", 8, 6, (100, 200, 300))),
        (picture("PNG", frames=2, duration=[500, 250]), ("image/png", 8, 6, (500, 250))),
        (
            (
                b'<?xml version="1.0"?><svg width="30" height="20px" xmlns="x">'
                b"<script>alert(1)</script></svg>"
            ),
            ("image/svg+xml", 30, 20, ()),
        ),
        (b'<svg xmlns="x" viewBox="0 0 9 9"/>', ("image/svg+xml", None, None, ())),
    ],
)
def test_inspect(data, expected):
    found = inspect(data, 10_000)
    assert (found.media_type, found.width, found.height, found.frames) == expected


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"<html><body>Not found</body></html>",
        b"GIF",
        picture("PNG")[:20],
        b"\x89PNG\r\n\x1a\nrubbish",
    ],
)
def test_no_picture(data):
    assert inspect(data, 10_000) is None


def test_large_pictures_are_not_decoded():
    """Above the limit the size is known and the frames are not looked at."""
    found = inspect(picture("GIF", (50, 50), frames=3, duration=100), 2000)
    assert (found.width, found.height, found.frames) == (50, 50, ())
    huge = picture("PNG")
    head = b"IHDR" + (60_000).to_bytes(4, "big") * 2 + huge[24:29]
    huge = huge[:12] + head + zlib.crc32(head).to_bytes(4, "big") + huge[33:]
    found = inspect(huge, 2000)
    assert (found.media_type, found.width, found.height) == ("image/png", 60_000, 60_000)


def test_cut_off_animation_keeps_the_frames_that_are_there():
    data = picture("GIF", (64, 64), frames=4, duration=[100, 200, 300, 400])
    found = inspect(data[: len(data) * 6 // 10], 10_000)
    assert (
        found is None
        or (1 <= len(found.frames) < 4 and found.frames == (100, 200, 300)[: len(found.frames)])
        or found.frames == ()
    )


def test_the_type_is_in_the_bytes_not_in_the_name():
    assert media_type(picture("JPEG")) == "image/jpeg"
    assert media_type(b"<!DOCTYPE html><svg-like>") is None


@pytest.fixture(scope="module")
def whole():
    """An image of many rows, with stretches of one colour."""
    image = Image.effect_noise((40, 3_000), 60).convert("RGB")
    for top, bottom in ((0, 40), (290, 331), (650, 1_500), (2_100, 2_110), (2_900, 3_000)):
        image.paste((top % 256, 200, 9), (0, top, 40, bottom))
    return image


def up(image) -> bytes:
    """As a browser packs for speed: RGB, every row as its difference to the one above."""
    held = io.BytesIO()
    image.save(held, "PNG")
    rows = b"".join(b"\x02" + row for row in differences(image))
    data = zlib.compress(rows, 1)
    parts = [held.getvalue()[:33]]
    for name, part in ((b"IDAT", data[:9]), (b"IDAT", data[9:]), (b"IEND", b"")):
        end = zlib.crc32(name + part).to_bytes(4, "big")
        parts.append(len(part).to_bytes(4, "big") + name + part + end)
    return b"".join(parts)


def differences(image) -> list[bytes]:
    stride, data = image.width * 3, bytes(image.width * 3) + image.tobytes()
    return [
        bytes(
            (one - two) % 256
            for one, two in zip(data[at + stride :][:stride], data[at:], strict=False)
        )
        for at in range(0, image.height * stride, stride)
    ]


def plain(image) -> bytes:
    """As Pillow packs: each row with a filter of its own."""
    return screenshot.encode(image)


def clear(image) -> bytes:
    """With an opaque fourth channel, as other browsers send it."""
    return screenshot.encode(image.convert("RGBA"))


@pytest.mark.parametrize("pack", [up, plain, clear])
def test_any_part_of_a_png_can_be_had(whole, pack):
    tall = whole.crop((0, 0, 40, 700))
    rows = PixelRows.read(pack(tall), 40, 700)
    for box in [
        (0, 0, 40, 700),
        (0, 0, 40, 1),
        (0, 699, 40, 700),
        (7, 255, 9, 257),
        (0, 256, 40, 512),
        (39, 511, 40, 513),
        (-5, 3, 50, 9),
        (-9, 3, -2, 9),
        (41, 3, 44, 9),
    ]:
        assert rows.part(box).tobytes() == tall.crop(box).tobytes(), box


@pytest.mark.parametrize("pack", [up, plain, clear])
def test_png_writer_joins_tiles(whole, tmp_path, pack):
    """The same pixels are the same bytes, however they were cut and packed."""
    for path, cut in (("a", 700), ("b", 1), ("c", 3_000)):
        with PngWriter(tmp_path / path, 40, 3_000) as png:
            for top in range(0, 3_000, cut) if cut > 1 else (0, 1, 2, 300):
                end = min(3_000, top + cut) if cut > 1 else {0: 1, 1: 2, 2: 300, 300: 3_000}[top]
                more = min(5, 3_000 - end)
                tile = whole.crop((0, top, 40, end + more))
                png.add(PixelRows.read(pack(tile), 40, tile.height), end - top)
    with Image.open(tmp_path / "a") as back:
        assert back.tobytes() == whole.tobytes()
    assert len({(tmp_path / path).read_bytes() for path in "abc"}) == 1


def test_png_writer_counts_rows(tmp_path):
    with (
        pytest.raises(Retryable, match="screenshot_size"),
        PngWriter(tmp_path / "x.png", 4, 9) as png,
    ):
        png.add(PixelRows.of(Image.new("RGB", (4, 8))), 8)
    with (
        pytest.raises(Retryable, match="screenshot_size"),
        PngWriter(tmp_path / "x.png", 4, 9) as png,
    ):
        png.add(PixelRows.of(Image.new("RGB", (5, 9))), 9)


def test_a_damaged_answer_is_asked_for_again(whole):
    good = up(whole.crop((0, 0, 40, 30)))
    cut = [good[:20], good[:60], good[:33], good.replace(b"IDAT", b"IDAX"), b"<html>", b""]
    short = up(whole.crop((0, 0, 40, 29)))
    for data in (*cut, good[:33] + short[33:], short[:33] + good[33:], short):
        with pytest.raises(Retryable, match="screenshot_"):
            PixelRows.read(data, 40, 29 if data[:33] == short[:33] and data != short else 30)


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
        return {"data": base64.b64encode(screenshot.encode(image)).decode()}


def test_repeated_tiles_are_found(tmp_path):
    good, bad = Repeating(10**9), Repeating(2 * screenshot.TILE)
    seam = {7: (3, screenshot.TILE - 900, 12, screenshot.TILE + 90), 8: (0, 0, 0, 5)}
    pieces = screenshot.take(good, tmp_path / "a.png", 20, 3 * screenshot.TILE, seam)
    assert Image.open(tmp_path / "a.png").tobytes() == good.page.tobytes()
    assert list(pieces) == [7]
    assert Image.open(io.BytesIO(pieces[7])).tobytes() == good.page.crop(seam[7]).tobytes()
    assert good.pictures == screenshot.tiles(3 * screenshot.TILE) == 4
    with pytest.raises(Retryable, match="screenshot_repeats"):
        screenshot.take(bad, tmp_path / "b.png", 20, 3 * screenshot.TILE)


class Blanking(Repeating):
    """A browser that leaves the end of a large picture white."""

    def devtools(self, command, params):
        answer = super().devtools(command, params)
        image = Image.open(io.BytesIO(base64.b64decode(answer["data"]))).convert("RGB")
        image.paste((255, 255, 255), (0, self.limit, *image.size))
        return {"data": base64.b64encode(screenshot.encode(image)).decode()}


@pytest.mark.parametrize("height", [2, 3])
def test_blank_ends_of_tiles_are_found(tmp_path, height):
    bad = Blanking(screenshot.TILE - 9)
    with pytest.raises(Retryable, match="screenshot_repeats"):
        screenshot.take(bad, tmp_path / "a.png", 20, height * screenshot.TILE)
