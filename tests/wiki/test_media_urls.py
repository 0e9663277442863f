"""Originals, file titles, licences, titles files: pure functions, one literal case a line."""

import pytest

from kb.wiki import media_urls

W = "https://wiki.example/images"


@pytest.mark.parametrize(
    ("src", "expected"),
    [
        (f"{W}/thumb/Ore.png/20px-Ore.png", f"{W}/Ore.png"),
        (f"{W}/thumb/a/ab/Ore.png/120px-Ore.png?5cbf3", f"{W}/a/ab/Ore.png"),
        (f"{W}/thumb/Mark.svg/80px-Mark.svg.png", f"{W}/Mark.svg"),
        (f"{W}/a/ab/Ore.png/revision/latest/scale-to-width-down/200?cb=2020", f"{W}/a/ab/Ore.png"),
        (f"{W}/a/ab/Ore.png?version=3", f"{W}/a/ab/Ore.png?version=3"),
        (f"{W}/Ore.png#top", f"{W}/Ore.png"),
        (f"{W}/thumbs/Ore.png", f"{W}/thumbs/Ore.png"),
    ],
)
def test_original(src, expected):
    assert media_urls.original(src) == expected


@pytest.mark.parametrize(
    ("src", "page", "expected"),
    [
        (f"{W}/thumb/a/ab/Iron_Ore.png/20px-Iron_Ore.png", None, "File:Iron Ore.png"),
        (f"{W}/x.png", "https://wiki.example/wiki/File:A%26B_%C3%A9.png", "File:A&B é.png"),
        (f"{W}/x.png", "https://wiki.example/w/index.php?title=File:C.png", "File:C.png"),
        (f"{W}/x.png", "https://wiki.example/wiki/Other", "File:x.png"),
        (f"{W}/a|b.png", None, None),
        (f"{W}/noending", None, None),
        ("data:image/png;base64,AA.A", None, None),
    ],
)
def test_file_title(src, page, expected):
    assert media_urls.file_title(src, page) == expected


@pytest.mark.parametrize(
    ("url", "text", "expected"),
    [
        ("https://creativecommons.org/licenses/by-nc-sa/3.0/", None, "CC-BY-NC-SA-3.0"),
        ("//creativecommons.org/licenses/by/4.0/deed.de", "", "CC-BY-4.0"),
        ("https://creativecommons.org/publicdomain/zero/1.0/", None, "CC0-1.0"),
        ("https://www.gnu.org/copyleft/fdl.html", None, "GFDL-1.3-or-later"),
        ("https://wiki.example/wiki/Copyright", "CC BY-SA 3.0", "CC-BY-SA-3.0"),
        ("https://wiki.example/wiki/Copyright", "Ask us", "https://wiki.example/wiki/Copyright"),
        ("", "", None),
        (None, None, None),
    ],
)
def test_licence(url, text, expected):
    assert media_urls.licence(url, text) == expected


@pytest.mark.parametrize(
    ("page", "expected"),
    [
        (
            {"imageinfo": [{"extmetadata": {"LicenseShortName": {"value": "CC BY-SA 4.0"}}}]},
            "CC-BY-SA-4.0",
        ),
        ({"imageinfo": [{"extmetadata": {"LicenseShortName": {"value": "Fair use"}}}]}, "Fair use"),
        (
            {
                "imageinfo": [{}],
                "extlinks": [
                    {"url": "https://x.example"},
                    {"url": "http://creativecommons.org/licenses/by/3.0/"},
                ],
            },
            "CC-BY-3.0",
        ),
        ({"imageinfo": [{}]}, None),
        ({}, None),
    ],
)
def test_file_licence(page, expected):
    assert media_urls.file_licence(page) == expected
