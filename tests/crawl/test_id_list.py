"""Lists of ids in the forms that other tools write, read by the rules of each source."""

import codecs
import gzip
import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import SettingError
from kb.reddit.crawl.ids import read_wanted
from kb.wiki.crawl.ids import NAMES, read_titles
from kb.youtube.crawl.ids import RULES as VIDEO_IDS

A, B = "aaaaaaaaaaa", "b-b_bbbbbbb"


def written(tmp_path: Path, text: str | bytes, name: str = "list") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def found(key: str) -> dict[str, Any]:
    """A result of search.list; its channel and pictures name no video of the list."""
    picture = {"default": {"url": "https://i.ytimg.com/vi/ccccccccccc/default.jpg"}}
    about = {"channelId": "UCkkkkkkkkk", "channelTitle": "KilnRoad123", "thumbnails": picture}
    return {"kind": "youtube#searchResult", "id": {"videoId": key}, "snippet": about}


def entry(key: str) -> dict[str, Any]:
    """An item of playlistItems.list, which has an id of its own."""
    about = {"resourceId": {"kind": "youtube#video", "videoId": key}, "title": "Description"}
    return {"id": "UExrkkkkkkkk.AAAA", "snippet": about, "contentDetails": {"videoId": key}}


VIDEOS = {
    "lines": f"\ufeff{A}\r\n\r\n# a note\r\nhttps://youtu.be/{B}?t=3\r\n{A}\r\n",
    "yt-dlp's download archive": f"youtube {A}\nyoutube {B}\n",
    "a playlist of yt-dlp": json.dumps(
        {"_type": "playlist", "id": "PL0", "entries": [{"id": A, "title": "x"}, {"id": B}]}
    ),
    "CSV": f'title,video_id\n"One, two",{A}\nx,{B}\n',
    "CSV with semicolons": f"Video_ID;views\n{A};1\n{B};2\n",
    "TSV": f'id\ttitle\n{A}\t"open\n{B}\tx\n',
    "CSV of addresses": f"n,url\n1,https://www.youtube.com/watch?v={A}&t=1\n2,https://youtu.be/{B}\n",
    "MineDojo's videos": json.dumps([{"id": A, "title": "x", "duration": 3}, {"id": B}]),
    "MineDojo's pairs": json.dumps({"items": [[A, 1, 2], [B, 3.5, 4]], "id": [[A, 5, 6]]}),
    "CLIP4MC's list": json.dumps(
        [{"vid": A, "transcript clip": "x", "size": [1.0], "begin position": 1}, {"vid": B}]
    ),
    "NDJSON": f'{{"video_id": "{A}"}}\n{{"video_id": "{B}"}}\n',
    "a list in JSON": json.dumps([A, B]),
    "UTF-16": f"{A}\r\nhttps://youtu.be/{B}\r\n".encode("utf-16"),
    "UTF-16, big end first": codecs.BOM_UTF16_BE
    + f"Video ID\tx\n{A}\t1\n{B}\t2".encode("utf-16-be"),
    "UTF-32": f'[{{"videoId": "{A}"}}, {{"videoId": "{B}"}}]'.encode("utf-32"),
    "UTF-16 in gzip": gzip.compress(f"{A}\n{B}\n".encode("utf-16")),
    "a playlist of Takeout": f"Video ID,Playlist Video Creation Timestamp\n{A},2024\n{B},2024\n",
    "an older playlist of Takeout": "Playlist Id,Channel Id,Title,Description\n"
    f'PLkkkkkkkkk,UCkkkkkkkkk,Pots,"glazes, kilns"\n\nVideo Id,Time Added\n {A},2024\n{B},2024\n',
    "a history of Takeout": json.dumps(
        [
            {
                "header": "YouTube",
                "title": "Watched a pot",
                "titleUrl": f"https://www.youtube.com/watch?v={key}",
                "subtitles": [{"name": "Kiln Road", "url": "https://www.youtube.com/channel/UCk"}],
            }
            for key in (A, B)
        ]
    ),
    "a search of the API": json.dumps(
        {"kind": "youtube#searchListResponse", "items": [found(A), found(B)]}
    ),
    "a playlist of the API": json.dumps({"items": [entry(A), entry(B)]}),
    "videos of the API": json.dumps({"items": [{"id": A, "etag": "x"}, {"id": B}]}),
    "answers of the API one a line": "".join(
        json.dumps({"items": [found(key)]}) + "\n" for key in (A, B)
    ),
    "pages of an API in a list": json.dumps([{"items": [{"id": A}]}, {"items": [{"id": B}]}]),
    "lists by another name": json.dumps(
        {"playlists": [{"videos": [{"videoId": A}, {"videoId": B}]}]}
    ),
    "several a line": f"https://youtu.be/{A}, {B}\n",
    "several in a line of words": f"youtu.be/{A} {B}\n{B}\n",
    "a list by another name": json.dumps({"ids": [A, B], "tags": ["description"]}),
    "objects by id below a name": json.dumps({"videos": {A: {"title": "x"}, B: {}}}),
    "objects by id": json.dumps({A: {"title": "Description"}, B: {"title": "x"}}),
    "an id that numbers rows": f"id,url\n1,https://youtu.be/{A}\n2,https://youtu.be/{B}\n",
    "a column that its values tell": f'Kiln,Source\n"One, two",{A}\nDescription,{B}\n',
    "a key that its values tell": json.dumps(
        [{"clip": A, "by": "Kiln Road"}, {"clip": B, "by": "description"}]
    ),
    "columns without a header": f"{A};A pot;KilnRoad\n{B};Description;x\n",
    "names of ActivityNet": json.dumps({f"v_{A}": {"duration": 82.7}, f"v_{B}": {"duration": 1}}),
    "videos of MSR-VTT": json.dumps(
        {
            "info": {"year": "2016"},
            "videos": [
                {"video_id": f"video{n}", "id": n, "url": f"https://www.youtube.com/watch?v={key}"}
                for n, key in enumerate((A, B))
            ],
        }
    ),
    "ids of clips": json.dumps(
        [{"videoID": f"{A}_000002_000012"}, {"videoID": f"{B}_000010_000020"}]
    ),
    "a long field": f'id,description\n{A},"{"x" * 200_000}"\n{B},y\n',
    "UTF-16 without a mark": f"Video ID,x\r\n{A},1\r\n{B},2\r\n".encode("utf-16-le"),
    "a list below data": json.dumps({"data": {"videos": [{"videoId": A}, {"videoId": B}]}}),
    "links of Markdown": f"- [A pot](https://youtu.be/{A}?t=1)\n- <https://youtu.be/{B}>\n",
    "gzip": gzip.compress(f"{A}\n{B}\n".encode()),
}


@pytest.mark.parametrize("form", VIDEOS)
def test_video_ids(tmp_path: Path, form: str) -> None:
    assert VIDEO_IDS.ids_in(written(tmp_path, VIDEOS[form]))[::2] == ([A, B], 0)


def test_entries_that_are_no_ids_are_counted_and_one_line_says_so(tmp_path: Path) -> None:
    said: list[str] = []
    path = written(tmp_path, f"youtube {A}\nvimeo 123456789\nnot an id\n")
    assert VIDEO_IDS.ids_in(path, said.append)[::2] == ([A], 2)
    (line,) = said
    assert "2 bad lines" in line
    assert "vimeo 123456789" in line
    odd = json.dumps([{"title": "x"}, None, A, {"id": None}, [], {}])
    assert VIDEO_IDS.ids_in(written(tmp_path, odd))[::2] == ([A], 4)
    with pytest.raises(SettingError):
        VIDEO_IDS.some_ids_in(written(tmp_path, "vimeo 1\n"))


def test_a_column_of_parquet_is_found_by_its_name_or_its_values(tmp_path: Path) -> None:
    for name in ("videoId", "Video ID", "clip"):
        path = tmp_path / f"{name}.parquet"
        pq.write_table(pa.table({"n": [1, 2], "title": ["x", "Description"], name: [A, B]}), path)
        assert VIDEO_IDS.ids_in(path)[::2] == ([A, B], 0)


def test_what_is_no_video_in_an_answer_is_counted(tmp_path: Path) -> None:
    channel = {"id": {"kind": "youtube#channel", "channelId": "UCkkkkkkkkk"}}
    playlist = {**found(A), "id": {"kind": "youtube#playlist", "playlistId": "PLkkkkkkkkk"}}
    text = json.dumps({"items": [found(A), channel, playlist]})
    assert VIDEO_IDS.ids_in(written(tmp_path, text))[::2] == ([A], 2)


@pytest.mark.parametrize(
    "text", ["https://vimeo.com/1?v=aaaaaaaaaaa\nx\n", "Playlist ID,Title\nPL0,Description\n"]
)
def test_a_list_without_ids_is_shown_by_its_first_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(SettingError) as error:
        VIDEO_IDS.some_ids_in(written(tmp_path, text))
    assert repr(text.splitlines()[0]) in str(error.value)
    assert error.value.exit_code == 2


TITLES = {
    "lines": "# a note\nIron_Ore\n\nGold\nIron Ore\n",
    "addresses": "https://w.example/wiki/Iron_Ore\nhttps://w.example/index.php?title=Gold\n",
    "addresses by index.php": "https://w.example/index.php/Iron_Ore\n"
    "https://w.example/w/index.php/Gold\nhttps://w.example/wiki/index.php/Gold\n",
    "allpages": json.dumps(
        {
            "batchcomplete": True,
            "query": {
                "allpages": [
                    {"pageid": 7, "ns": 0, "title": "Iron Ore"},
                    {"pageid": 8, "ns": 0, "title": "Gold"},
                    {"pageid": 9, "ns": 14, "title": "Category:Ores"},
                ]
            },
        }
    ),
    "answers of allpages one a line": "\n".join(
        json.dumps({"query": {"allpages": [{"pageid": 1, "ns": 0, "title": title}]}})
        for title in ("Iron Ore", "Gold")
    ),
    "a dump's list of all titles": "page_namespace\tpage_title\n1\tGold\n0\tIron_Ore\n0\tGold\n",
    "the same without a header": "1\tGold\n0\tIron_Ore\n0\tGold\n-1\tx\n",
    "a dump's list of titles": gzip.compress(b"page_title\nIron_Ore\nGold\n"),
    "CSV": "page_id,title\n1,Iron Ore\n2,Gold\n",
    "MineDojo's pages": json.dumps(
        [
            {"metadata": {"url": "https://w.example/wiki/Iron_Ore", "title": "Iron Ore – A Wiki"}},
            {"metadata": {"url": "https://w.example/wiki/Gold", "title": "Gold"}, "tables": []},
        ]
    ),
}


@pytest.mark.parametrize("form", TITLES)
def test_titles(tmp_path: Path, form: str) -> None:
    found = read_titles(written(tmp_path, TITLES[form]))
    assert (found.keys, found.bad_lines) == (["Iron Ore", "Gold"], 0)


def test_titles_of_the_profile_s_namespaces(tmp_path: Path) -> None:
    path = written(tmp_path, "0\tGold\n10\tOre_box\n4000\tGuide\n2\tMe\n")
    found = read_titles(path, (0, 10, 4000))
    # What a wiki calls a namespace of its own, such a list does not say.
    assert (found.keys, found.bad_lines) == (["Gold", "Template:Ore box"], 1)


def test_a_wiki_full_folder(tmp_path: Path) -> None:
    for place, title in (("wiki/Iron_Ore", "Iron_Ore"), ("wiki/Gold", "Gold"), (".trash/x", "No")):
        folder = tmp_path / "wiki_full" / place
        folder.mkdir(parents=True)
        url, shown = f"https://w.example/wiki/{title}", title.replace("_", " ") + " – A Wiki"
        about = {"url": url, "title": shown, "time": "01/01/2022 00:00:00"}
        texts = [{"text": "Not a title", "bbox": [1, 2, 3, 4]}]
        written(folder, json.dumps({"metadata": about, "texts": texts}), "data.json")
    assert read_titles(tmp_path / "wiki_full").keys == ["Gold", "Iron Ore"]


@pytest.mark.parametrize("text", ["<mediawiki>\n<page>", '\ufeff\n<?xml version="1.0"?>\n<x/>'])
def test_xml_is_refused(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text, "dump.xml")
    for read in (read_titles, NAMES.ids_in, VIDEO_IDS.ids_in, read_wanted):
        with pytest.raises(SettingError, match="XML") as error:
            read(path)
        assert error.value.exit_code == 2


def test_pages_by_id_are_told_from_titles_that_are_numbers(tmp_path: Path) -> None:
    found = NAMES.ids_in(written(tmp_path, json.dumps([7, "2048", {"page_id": 9, "title": "x"}])))
    assert (found.keys, found.numbers) == (["7", "2048", "9"], {"7", "9"})


def test_reddit_names_and_trees(tmp_path: Path) -> None:
    lines = "t3_abc\nT1_DEF\nhttps://www.reddit.com/r/x/comments/ghi/a_title/\n"
    lines += "https://old.reddit.com/r/x/comments/ghi/a_title/jkl/?context=3\nhello\n"
    wanted = read_wanted(written(tmp_path, lines))
    assert list(wanted.names) == ["t3_abc", "t1_def", "t3_ghi", "t1_jkl"]
    assert (wanted.trees, wanted.bad_lines) == ([], 1)
    wanted = read_wanted(written(tmp_path, "n,comment_id\n1,abc\n2,t1_def\n"))
    assert list(wanted.names) == ["t1_abc", "t1_def"]
    wanted = read_wanted(written(tmp_path, json.dumps([{"id": "abc", "type": "text"}, "t3_def"])))
    assert ([*wanted.names], wanted.trees) == ([], ["abc", "def"])


@pytest.mark.parametrize("read", [VIDEO_IDS.some_ids_in, read_titles, read_wanted])
def test_what_cannot_be_read_is_a_wrong_option(read, tmp_path: Path) -> None:
    other = tmp_path / "other.parquet"
    pq.write_table(pa.table({"n": [1]}), other)
    for path in (
        tmp_path / "nowhere",
        tmp_path,
        other,
        written(tmp_path, "", "empty"),
        written(tmp_path, "{", "cut.json"),
        written(tmp_path, b"\xff\x00x", "binary"),
        written(tmp_path, b"\x1f\x8b\x08cut", "cut.gz"),
    ):
        with pytest.raises(SettingError):
            read(path)
