"""Media types by bytes, sizes by headers, frames within limits; tall PNGs in bounded memory."""

from __future__ import annotations

import base64
import io
import zlib

import pytest
from PIL import Image

from kb.core.errors import Retryable
from kb.wiki import screenshot
from kb.wiki.images import inspect, media_type
from kb.wiki.png import PngWriter


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


def test_png_writer_joins_tiles(tmp_path):
    whole = Image.effect_noise((40, 30), 60).convert("RGB")
    path = tmp_path / "x.png"
    with PngWriter(path, 40, 30) as png:
        for top in (0, 7, 14, 21, 28):
            png.add(whole.crop((0, top, 40, min(30, top + 7))))
    with Image.open(path) as back:
        assert back.tobytes() == whole.tobytes()


def test_png_writer_counts_rows(tmp_path):
    with (
        pytest.raises(Retryable, match="screenshot_size"),
        PngWriter(tmp_path / "x.png", 4, 9) as png,
    ):
        png.add(Image.new("RGB", (4, 8)))
    with (
        pytest.raises(Retryable, match="screenshot_size"),
        PngWriter(tmp_path / "x.png", 4, 9) as png,
    ):
        png.add(Image.new("RGB", (5, 9)))


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
    screenshot.take(good, tmp_path / "a.png", 20, 3 * screenshot.TILE)
    assert Image.open(tmp_path / "a.png").tobytes() == good.page.tobytes()
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
