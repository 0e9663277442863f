"""Media types by bytes, sizes by headers, frames within limits."""

import io
import random
import zlib
from collections import Counter

import pytest
from PIL import Image

from kb.wiki.capture import media_type as media
from kb.wiki.capture.media_type import inspect, media_type


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


@pytest.mark.parametrize("digits", [12, 30, 400, 100_000])
def test_a_size_that_no_table_holds_is_none(digits):
    found = inspect(b'<svg width="%s" height="20">' % (b"9" * digits), 10_000)
    assert (found.width, found.height) == (None, 20 if digits < 4000 else None)


def test_frames_that_are_too_many_pixels_together_are_not_decoded(monkeypatch):
    monkeypatch.setattr(media, "MAX_PIXELS", 3 * 64 * 64)
    few = picture("GIF", (64, 64), frames=3, duration=100)
    many = picture("GIF", (64, 64), frames=4, duration=100)
    assert inspect(few, 10_000).frames == (100, 100, 100)
    assert inspect(many, 10_000).frames == ()


KINDS = ("PNG", "JPEG", "WEBP", "GIF", "BMP", "TIFF", "ICO", "AVIF")


@pytest.mark.slow
def test_whatever_a_decoder_raises_is_no_picture():
    """10,000 files: bytes of each format's header and of the rest changed, cut or repeated."""
    rng = random.Random(51)
    seen = Counter()
    for kind in KINDS:
        base = picture(kind, (33, 21), frames=3 if kind in ("PNG", "GIF", "WEBP") else 1)
        for _ in range(1250):
            data = bytearray(base)
            for _ in range(rng.choice([1, 2, 8])):
                at = rng.randrange(min(len(data), rng.choice([64, 512, len(data)])))
                data[at] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)])
            if rng.random() < 0.3:
                del data[rng.randrange(8, len(data)) :]
            found = inspect(bytes(data), 1_000_000)
            seen[kind, found is None] += 1
            if found is not None:
                assert all(one is None or 0 <= one < 2**32 for one in (found.width, found.height))
                assert all(one is None or 0 <= one < 2**31 for one in found.frames)
    assert all(seen[kind, True] or seen[kind, False] for kind in KINDS)
