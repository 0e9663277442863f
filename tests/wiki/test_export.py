"""The released tar shards and MineDojo's layout, from rows made by hand."""

import dataclasses
import hashlib
import json
import tarfile

import jsonschema
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from kb.core.errors import DamagedData, FatalError
from kb.export import minedojo
from kb.schema import table
from kb.store.tables.shard_writer import write_table
from kb.wiki import tar_shards

BOX = {
    "type": "array",
    "prefixItems": [*[{"type": "number"}] * 2, *[{"type": "integer", "minimum": 1}] * 2],
    "minItems": 4,
    "maxItems": 4,
}
CELLS = {
    "type": "object",
    "required": ["text", "bboxes"],
    "additionalProperties": False,
    "properties": {
        "text": {"type": "array", "items": {"type": "string"}},
        "bboxes": {"type": "array", "items": BOX},
    },
}
TEXT = {
    "type": "object",
    "required": ["text", "bbox"],
    "additionalProperties": False,
    "properties": {"text": {"type": "string", "minLength": 1}, "bbox": BOX},
}
WORDS = {"type": ["string", "null"], "minLength": 1}
PUBLISHED = {  # the layout as published, see kb/export/minedojo.py
    "type": "object",
    "required": ["metadata", "tables", "images", "sprites", "texts"],
    "additionalProperties": False,
    "properties": {
        "metadata": {
            "type": "object",
            "required": ["url", "title", "time"],
            "additionalProperties": False,
            "properties": {
                "url": {"type": "string"},
                "title": {"type": "string"},
                "time": {"type": "string", "pattern": r"^\d\d/\d\d/\d{4} \d\d:\d\d:\d\d$"},
            },
        },
        "tables": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["bbox", "headers", "cells"],
                "additionalProperties": False,
                "properties": {"bbox": BOX, "headers": CELLS, "cells": CELLS},
            },
        },
        "images": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["src", "path", "alt_text", "caption", "bbox"],
                "additionalProperties": False,
                "properties": {
                    **{name: {"type": "string"} for name in ("src", "path", "alt_text")},
                    "caption": WORDS,
                    "bbox": BOX,
                },
            },
        },
        "sprites": {"type": "array", "items": {**TEXT, "properties": {"text": WORDS, "bbox": BOX}}},
        "texts": {"type": "array", "items": TEXT},
    },
}


@pytest.fixture
def run(run_on, tmp_path, make_rows):
    """Two pages; the second one's address wants to leave its folder."""
    root = tmp_path / "data"
    images = root / "raw/wiki/images"
    images.mkdir(parents=True)
    Image.new("RGB", (30, 20), (9, 9, 9)).save(images / "aaaa.png")
    (images / "bbbb.svg").write_text(
        "<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'><script>x</script></svg>"
    )
    for page in (1, 2):
        folder = root / f"raw/wiki/pages/{page}/5"
        folder.mkdir(parents=True)
        Image.new("RGB", (100, 300), (page * 50, 0, 0)).save(folder / "screenshot.png")
    url = "https://wiki.example/wiki/"
    put(
        root,
        make_rows(
            "wiki/pages",
            2,
            page_id=[1, 2],
            title=["One", "Two"],
            url=[url + "One", url + "..%2F..%2Fetc/.Two"],
            screenshot_path=[f"raw/wiki/pages/{n}/5/screenshot.png" for n in (1, 2)],
            toxicity=[0.1, None],
        ),
        "wiki/pages",
    )
    kinds = ["text", "table", "cell", "cell", "image", "image", "sprite", "text"]
    put(
        root,
        make_rows(
            "wiki/elements",
            8,
            page_id=[1] * 8,
            element_id=list(range(8)),
            parent_id=[None] * 8,
            kind=kinds,
            text=["Head", None, "H", "c", None, None, None, "hidden"],
            visible=[True] * 7 + [False],
            heading_level=[None] * 8,
            reading_order=list(range(8)),
            **{name: [10.4] * 8 for name in ("x", "y", "width", "height")},
        ),
        "wiki/elements",
    )
    put(
        root,
        make_rows(
            "wiki/cells",
            2,
            page_id=[1, 1],
            table_id=[1, 1],
            row_index=[0, 0],
            column_index=[0, 1],
            is_header=[True, False],
            text=["H", "c"],
        ),
        "wiki/cells",
    )
    put(
        root,
        make_rows(
            "wiki/images",
            4,
            page_id=[1] * 4,
            element_id=[4, 5, 6, 6],
            frame_index=[None, None, 0, 1],
            sha256=["aaaa", "bbbb", None, None],
            path=["raw/wiki/images/aaaa.png", "raw/wiki/images/bbbb.svg", None, None],
            media_type=["image/png", "image/svg+xml", None, None],
            caption=["a caption", None, None, None],
            alt_text=[None] * 4,
            license=["CC-BY-4.0", None, None, None],
        ),
        "wiki/images",
    )
    return run_on(root, "https://wiki.example")


def put(root, rows, name):
    write_table(root / "clean" / "wiki" / table(name).short / "part-00000.parquet", rows, name)


def test_tars_tables_and_index_agree(run):
    tar_shards.export(run)
    folder = run.root / "release" / "wiki"
    index = [json.loads(line) for line in (folder / "index.ndjson").read_text().splitlines()]
    names = {f"{line['tar']}/{line['member']}" for line in index}
    pages, images = (
        pq.read_table(folder / f"{name}-00000-of-00001.parquet") for name in ("pages", "images")
    )
    assert pages["screenshot_path"].to_pylist() == [
        f"screenshots-00000-of-00001.tar/{n:09d}.png" for n in (1, 2)
    ]
    assert set(filter(None, images["path"].to_pylist())) == {
        f"images-00000-of-00001.tar/{name}" for name in ("aaaa.png", "bbbb.svg")
    }
    assert {
        *pages["screenshot_path"].to_pylist(),
        *filter(None, images["path"].to_pylist()),
    } <= names
    for line in index:
        data = (folder / line["tar"]).read_bytes()[line["offset"] : line["offset"] + line["size"]]
        assert hashlib.sha256(data).hexdigest() == line["sha256"]
        with tarfile.open(folder / line["tar"]) as tar:
            member = tar.getmember(line["member"])
            assert (member.mtime, member.uid, member.uname, member.mode) == (0, 0, "", 0o644)
            assert tar.extractfile(member).read() == data
    keys = [line["member"].split(".")[0] for line in index]
    assert keys == sorted(keys, key=keys.index)
    assert len(keys) == 2 * len(set(keys))


def test_same_rows_same_bytes(run, tmp_path):
    import shutil

    tar_shards.export(run)
    other = tmp_path / "other"
    shutil.copytree(run.root, other)
    shutil.rmtree(other / "release")
    tar_shards.export(dataclasses.replace(run, root=other, workers=1))
    for path in sorted((run.root / "release/wiki").iterdir()):
        assert path.read_bytes() == (other / "release/wiki" / path.name).read_bytes(), path.name


def test_tars_are_split_by_size(run, monkeypatch):
    monkeypatch.setattr(tar_shards, "TAR_BYTES", 1500)
    assert tar_shards.export(run)["tars"] == 4
    assert {path.name for path in (run.root / "release/wiki").glob("*.tar")} == {
        f"{kind}-0000{n}-of-00002.tar" for kind in ("images", "screenshots") for n in (0, 1)
    }


def files_below(folder):
    return {
        path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def test_minedojo_samples_are_the_first_pages(run, monkeypatch):
    monkeypatch.setattr(minedojo, "_SAMPLES", 1)
    minedojo.wiki(run)
    assert [path.name for path in (run.root / "export/minedojo/wiki_samples").iterdir()] == ["One"]


def test_minedojo_layout(run):
    minedojo.wiki(run)
    root = run.root / "export/minedojo/wiki_full"
    folders = sorted(path.parent.relative_to(root).as_posix() for path in root.rglob("data.json"))
    assert folders == ["%2ETwo", "One"]
    assert all(not part.startswith(".") for name in folders for part in name.split("/"))
    for path in root.rglob("data.json"):
        data = json.loads(path.read_text(encoding="ascii"))
        jsonschema.validate(data, PUBLISHED)
        for image in data["images"]:
            with Image.open(path.parent / image["path"]) as opened:
                opened.load()
        with Image.open(path.parent / "screenshot.png") as opened:
            opened.load()
    samples = root.with_name("wiki_samples")  # what its loader reads with full=False
    assert files_below(samples) == files_below(root)
    data = json.loads((root / "One/data.json").read_text())
    assert [text["text"] for text in data["texts"]] == ["Head"]
    assert data["tables"][0]["headers"]["text"] == ["H"]
    assert data["tables"][0]["cells"]["text"] == ["c"]
    assert [image["caption"] for image in data["images"]] == ["a caption", None]
    assert data["sprites"] == [{"text": None, "bbox": [10.4, 10.4, 10, 10]}]
    assert all(type(value) is float for text in data["texts"] for value in text["bbox"][:2])


def test_texts_stand_once_and_in_no_table(run, make_rows):
    """As in the published data: no text inside of a table, none that another one holds."""
    shown = [
        # id, parent, kind, text, visible
        (0, None, "text", "Uses", True),
        (1, None, "text", "Fuel for\n  a furnace.  Food, at sea.", True),
        (2, 1, "text", "Fuel for a furnace.", True),
        (3, 1, "text", "Food, at sea.", True),
        (4, 3, "text", "at sea.", True),
        (5, None, "table", None, True),
        (6, 5, "cell", "4", True),
        (7, 6, "text", "4", True),
        (8, 5, "text", "Pieces a bed", True),
        (9, None, "text", "a hidden list: one", False),
        (10, 9, "text", "one", True),
        (11, None, "text", "Uses", True),
        (12, None, "text", "own words only", True),
        (13, 12, "text", "of a child", True),
        (14, 15, "text", "round", True),
        (15, 14, "text", "round", True),
    ]
    names = ("element_id", "parent_id", "kind", "text", "visible")
    columns = dict(zip(names, map(list, zip(*shown, strict=True)), strict=True))
    rows = make_rows(
        "wiki/elements",
        len(shown),
        page_id=[1] * len(shown),
        reading_order=list(range(len(shown))),
        heading_level=[None] * len(shown),
        **columns,
    )
    put(run.root, rows, "wiki/elements")
    minedojo.wiki(run)
    data = json.loads((run.root / "export/minedojo/wiki_full/One/data.json").read_text())
    texts = [text["text"] for text in data["texts"]]
    assert texts == ["Uses", shown[1][3], "one", "Uses", "own words only", "of a child"]


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("../secret.png", "which is not in"),
        ("raw/wiki/images/../../../../secret.png", "which is not in"),
        ("link", "it leads out of the data root, and no checksum describes it"),
    ],
)
def test_no_path_in_data_leads_out_of_the_data_root(run, path, said):
    secret = run.root.parent / "secret.png"
    secret.write_bytes(b"somebody else's")
    if path == "link":
        path = "raw/wiki/images/aaaa.png"
        (run.root / path).unlink()
        (run.root / path).symlink_to(secret)
    part = run.root / "clean" / "wiki" / "images" / "part-00000.parquet"
    rows = pq.read_table(part)
    paths = [
        path if value == "raw/wiki/images/aaaa.png" else value for value in rows["path"].to_pylist()
    ]
    place = rows.column_names.index("path")
    write_table(part, rows.set_column(place, "path", pa.array(paths, pa.string())), "wiki/images")
    for write in (tar_shards.export, minedojo.wiki):
        with pytest.raises(DamagedData, match=said):
            write(run)


def test_nothing_to_export_and_lost_files(run, run_on, tmp_path):
    empty = run_on(tmp_path / "empty", "https://wiki.example")
    for write in (tar_shards.export, minedojo.wiki):
        with pytest.raises(FatalError, match="nothing to export"):
            write(empty)
    (run.root / "raw/wiki/images/aaaa.png").unlink()
    with pytest.raises(DamagedData, match=r"aaaa.png is not there"):
        tar_shards.export(run)


@pytest.mark.parametrize(
    ("title", "url", "expected"),
    [
        ("Iron Ore", "https://w.example/wiki/Iron_Ore", "Iron_Ore"),
        ("Creeper", "https://w.example/w/Creeper", "Creeper"),
        ("Café", "https://w.example/w/Caf%C3%A9", "Caf%C3%A9"),
        ("Café", "https://w.example/w/Café", "Caf%C3%A9"),
        ("Jeb's Ore?", "https://w.example/w/Jeb's_Ore%3F", "Jeb's_Ore%3F"),
        ("Old/Redstone", "https://w.example/w/Old/Redstone", "Old/Redstone"),
        ("Help:Ore", "https://w.example/w/Help:Ore", "Help%3AOre"),
        ("A/B", "https://w.example/wiki/A%2FB", "A%2FB"),
        ("Renamed since", "https://w.example/wiki/Before", "Before"),
        ("..", "https://w.example/wiki/..", "%2E."),
        (".hidden", "https://w.example/wiki/.hidden", "%2Ehidden"),
        ("Main Page", "https://w.example/", "_"),
        ("x", "https://w.example/wiki/%00x", "%00x"),
        ("A b/c", "https://w.example/index.php?title=A_b/c", "A_b/c"),
        ("X/data.json", "https://w.example/wiki/X/data.json", "X/%64ata.json"),
        ("X/Images/y", "https://w.example/wiki/X/Images/y", "X/%49mages/y"),
        ("Images", "https://w.example/wiki/Images", "Images"),
    ],
)
def test_folder_name(title, url, expected):
    assert minedojo.folder_name(url, title) == expected
    assert all(step not in ("", ".", "..") for step in expected.split("/"))


def test_long_names_stay_apart():
    one, two = (
        minedojo.folder_name(f"https://w.example/wiki/{'é' * 300}{end}", f"{'é' * 300}{end}")
        for end in "ab"
    )
    assert one != two
    assert max(len(part.encode()) for part in one.split("/")) < 255
