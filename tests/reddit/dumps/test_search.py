"""Records of dumps are found by their subreddit or their ids."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as some

from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps.files import Chunk
from kb.reddit.dumps.search import CHECKED, ById, IdIndex, SubredditSearch, write_index
from tests.reddit.dumped import comment, imported, post, run_in, write


def test_a_space_after_the_colon_and_none(tmp_path):
    tight = json.dumps(post("tight"), separators=(",", ":")).encode()
    assert (
        import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", [tight, post("wide")])])[
            "crawled"
        ]
        == 2
    )


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("own", "others"), [(None, None), ("t5_2r05i", "t5_2qhw1"), ("t5_2r05i", "t5_2r05i"), (7, [7])]
)
def test_every_spelling_of_the_name_in_any_order(tmp_path, order, own, others):
    other = post("x", subreddit="gardening", selftext="leaf " * 200, subreddit_id=others)
    named = [
        post(key, subreddit=name, subreddit_id=own)
        for key, name in zip(
            "abcd", ("Minecraft", "minecraft", "MineCraft", "MINECRAFT"), strict=True
        )
    ]
    lines = [named[0], *[other] * 3_000, *named[1:3], *[other] * 3_000, named[3]]
    import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", lines[::order])])
    assert sorted(data["id"] for _, data in imported(tmp_path)) == ["a", "b", "c", "d"]


@pytest.mark.parametrize("name", ["aw", "body", "R2D2_abcdef", "12345678", "a_b_c_d_e_f"])
def test_names_of_any_length_and_signs(name):
    spelled = [name, name.lower(), name.upper(), name.swapcase()]
    others = [name + "x", "x" + name, name[1:], name[:-1], "pics"]
    lines = [comment(one, subreddit=one) for one in (*others, *spelled) for _ in range(200)]
    data = b"".join(json.dumps(line).encode() + b"\n" for line in lines)
    taken = []
    found = SubredditSearch(name)(
        Chunk(CHECKED, data, 0, len(data)), lambda _, record: taken.append(record["subreddit"])
    )
    assert taken == [one for one in spelled for _ in range(200)]
    assert found == (len(lines), 0, None)


def test_a_page_of_an_api_is_read_as_its_records(tmp_path):
    """An archive's answer, and Reddit's own listing with nested replies."""
    inner = {"kind": "Listing", "data": {"children": [{"kind": "t1", "data": comment("r")}]}}
    nested = comment("b") | {"replies": inner}
    things = [{"kind": "t3", "data": post("a")}, {"kind": "t1", "data": nested}]
    listing = {"kind": "Listing", "data": {"after": None, "children": things}}
    other = post("x", subreddit="gardening")
    pages = [listing, {"data": [post("c"), other]}, {"data": {"children": 5}}, {"data": []}]
    summary = import_dumps(run_in(tmp_path), [write(tmp_path / "page.json", pages)])
    assert (summary["crawled"], summary["bad_lines"]) == (4, 0)
    assert sorted(data["id"] for _, data in imported(tmp_path)) == ["a", "b", "c", "r"]


LINE = some.one_of(
    some.builds(
        lambda key, name: json.dumps({"id": key, "subreddit": name, "title": "t"}).encode(),
        some.text("abc", min_size=1, max_size=5),
        some.sampled_from(["Minecraft", "minecraft", "mINECRAFT", "pics", "MinecraftBuilds"]),
    ),
    some.binary(max_size=20).filter(
        lambda line: (
            b"\n" not in line
            and b"\r" not in line
            and line.strip()
            and not line.strip().startswith(b"{")
        )
    ),
)


@given(some.lists(LINE, max_size=30), some.sampled_from([0, CHECKED]))
def test_search_finds_what_reading_every_line_finds(lines, start):
    chunk = b"".join(line + b"\n" for line in lines)
    taken = []
    found = SubredditSearch("Minecraft")(
        Chunk(start, b"x" + chunk + b"x", 1, len(chunk) + 1),
        lambda _, record: taken.append(record["id"]),
    )
    wanted = [
        json.loads(line)["id"]
        for line in lines
        if line.startswith(b"{") and json.loads(line)["subreddit"].lower() == "minecraft"
    ]
    assert taken == wanted
    assert found.lines == len(lines)
    bad = [n for n, line in enumerate(lines) if not line.startswith(b"{")]
    assert found.bad_lines == len(bad)
    assert found.first_bad == (
        start + sum(len(line) + 1 for line in lines[: bad[0]]) if bad else None
    )


def test_ids_of_any_length_and_kind(tmp_path: Path) -> None:
    write_index(
        ["t3_a", "t1_abcdefg", "t1_abcdefgh", "t3_abcdefghijk"], ["tree1"], tmp_path / "ids"
    )
    search = ById(IdIndex(tmp_path / "ids"))
    lines = [
        {"id": "a", "title": ""},
        {"id": "a", "body": ""},  # a comment of that id was not asked for
        {"id": "abcdefg", "body": ""},
        {"id": "abcdefgh", "body": ""},
        {"id": "abcdefghi", "body": ""},
        {"id": "abcdefghijk", "title": ""},
        {"id": "x", "media": {"id": "a"}, "title": ""},
        {"body": "", "link_id": "t3_tree1", "id": "reply"},
        {"id": "tree1", "title": "", "body": '"id":"a"'},
        {"id": 7, "title": ""},
    ]
    for separators in ((",", ":"), None):
        data = b"".join(json.dumps(one, separators=separators).encode() + b"\n" for one in lines)
        taken: list[object] = []
        chunk = Chunk(1 << 30, data, 0, len(data))
        found = search(chunk, lambda _, record, taken=taken: taken.append(record["id"]))
        assert taken == [*("a", "abcdefg", "abcdefgh", "abcdefghijk", "reply", "tree1")]
        assert (found.lines, found.bad_lines) == (len(lines), 0)
