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
        (
            "https://wiki.example/w/thumb.php?f=Ore.png&width=32",
            "https://wiki.example/w/thumb.php?f=Ore.png",
        ),
        (
            "https://wiki.example/wiki/Special:FilePath/Ore.png?width=60",
            "https://wiki.example/wiki/Special:FilePath/Ore.png",
        ),
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
    ("src", "page", "expected"),
    [
        ("https://wiki.example/w/thumb.php?f=Ore_vein.png&width=32", None, "File:Ore vein.png"),
        (f"{W}/x.png", "https://wiki.example/wiki/Datei:Erz.png", "File:Erz.png"),
        (f"{W}/x.png", "https://wiki.example/index.php?title=bild%3AErz_1.png", "File:Erz 1.png"),
        (f"{W}/x.png", "https://wiki.example/wiki/Datei_alt:Erz.png", "File:Erz.png"),
        (f"{W}/x.png", "https://wiki.example/wiki/Akte:Erz.png", "File:x.png"),
    ],
)
def test_files_of_a_wiki_in_another_language(src, page, expected):
    assert media_urls.file_title(src, page, ("File", "Datei", "Bild", "Datei alt")) == expected


def test_an_original_is_never_where_only_a_thumbnail_is():
    thumb = "https://wiki.example/w/thumb.php?f=Ore.png&width=32"
    assert media_urls.sources(media_urls.original(thumb), thumb) == []
    scaled = f"{W}/thumb/a/ab/Ore.png/120px-Ore.png"
    assert media_urls.sources(media_urls.original(scaled), scaled) == [f"{W}/a/ab/Ore.png"]
    whole = f"{W}/a/ab/Ore.png/revision/latest?cb=2020"
    assert media_urls.sources(media_urls.original(whole), whole) == [f"{W}/a/ab/Ore.png", whole]


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
