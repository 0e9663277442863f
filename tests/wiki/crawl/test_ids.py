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
                    "title": "x",
                }
            }
        )
    )
    assert read_titles(minedojo).keys == ["Café & Bar"]
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
