"""Lists of titles, in every form that `--titles` takes."""

import json

import pytest

from kb.core.errors import SettingError
from kb.wiki.crawl.ids import read_titles


def test_read_titles(tmp_path, make_rows):
    import pyarrow.parquet as pq

    lines, parquet, minedojo = tmp_path / "t.txt", tmp_path / "t.parquet", tmp_path / "data.json"
    lines.write_text("# a comment\nIron_Ore\n\nGold\nIron Ore\n")
    assert read_titles(lines)[::2] == (["Iron Ore", "Gold"], 0)
    pq.write_table(make_rows("wiki/pages", 3, released=True, title=["A", "B", "A"]), parquet)
    assert read_titles(parquet).keys == ["A", "B"]
    with pytest.raises(SettingError, match="contains no released pages"):
        read_titles(tmp_path)
    (tmp_path / "pages-00000-of-00001.parquet").write_bytes(parquet.read_bytes())
    assert read_titles(tmp_path).keys == ["A", "B"]
    minedojo.write_text(
        json.dumps(
            {
                "metadata": {
                    "url": "https://minecraft.fandom.com/wiki/Caf%C3%A9_%26_Bar",
                    "title": "Café & Bar – Minecraft Wiki",
                }
            }
        )
    )
    assert read_titles(minedojo).keys == ["Café & Bar"]
    # The browser shows another page's title where the address is a redirect.
    for title, url in (
        ("Kiln – Valley Wiki", "https://w.example/wiki/Old_oven"),
        ("Old oven", "https://w.example/items/5"),
        ("Old oven", "https://w.example/wiki/?curid=5"),
    ):
        minedojo.write_text(json.dumps({"metadata": {"url": url, "title": title}}))
        assert read_titles(minedojo).keys == ["Old oven"]
    # A byte order mark, addresses of either path, and lines that would ask for something else: two
    # titles, none.
    lines.write_text(
        "\ufeffAlpha\nhttps://w.example/w/Iron_Ore\nhttp://w.example/w/index.php?title=Gold\nA|B\na\x1fC\n__\n"
        + "x" * 2000
    )
    assert read_titles(lines)[::2] == (["Alpha", "Iron Ore", "Gold"], 4)
    minedojo.write_text('\ufeff["B", {"title": "C"}, {"metadata": 3}, null, true]')
    assert read_titles(minedojo)[::2] == (["B", "C"], 3)
    for bad in ("", "\n\n", "|\n"):
        lines.write_text(bad)
        with pytest.raises(SettingError, match="contains no titles"):
            read_titles(lines)


@pytest.mark.parametrize(
    ("line", "title"),
    [
        ("https://kiln.example/wiki/Raku_Kiln?oldid=7#Uses", "Raku Kiln"),
        ("https://www.kiln.example/index.php/Raku_Kiln", "Raku Kiln"),
        ("https://m.kiln.example/w/index.php/Slip/Casting", "Slip/Casting"),
        ("https://kiln.example/w/index.php?action=edit&title=Slip_Casting", "Slip Casting"),
        ("https://kiln.example/zh-tw/%E7%AA%AF", "窯"),
        ("https://kiln.example/Raku", "Raku"),
        ("[[Raku Kiln]]", "Raku Kiln"),
        ("[[:Raku Kiln#Uses|the kiln]]", "Raku Kiln"),
        ("https://kiln.example/?curid=5", None),
        ("https://kiln.example/w/index.php?oldid=9", None),
        ("https://other.example/wiki/Raku_Kiln", None),
    ],
)
def test_addresses_and_links_of_one_wiki(tmp_path, line, title):
    path = tmp_path / "titles.txt"
    path.write_text(f"Always\n{line}\n", encoding="utf-8")
    listed = read_titles(path, roots=["https://kiln.example"])
    assert listed.keys == ["Always", *([title] if title else [])]
    assert listed.bad_lines == (title is None)


def test_a_copy_on_loopback_takes_the_addresses_of_its_original(tmp_path):
    path, copy = tmp_path / "titles.txt", ["http://127.0.0.1:8000"]
    path.write_text("https://kiln.example/wiki/Raku\n")
    assert read_titles(path, roots=copy).keys == ["Raku"]
    path.write_text("http://127.0.0.1:8000/wiki/Slip\nhttps://kiln.example/wiki/Raku\n")
    assert read_titles(path, roots=copy)[::2] == (["Slip"], 1)


def test_titles_of_a_table_with_addresses(tmp_path):
    path = tmp_path / "titles.csv"
    path.write_text(
        "title,url\nRaku Kiln,https://kiln.example/index.php/Raku_Kiln\n"
        "Slip Casting,https://kiln.example/?curid=4\n"
        "Ash – Kiln Wiki,https://kiln.example/wiki/Ash\n"
    )
    assert read_titles(path).keys == ["Raku Kiln", "Slip Casting", "Ash"]
