"""Other layouts of pairs, read by what they are made for."""

import importlib.util
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import jsonschema
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import freshness
from kb.artifacts.makers import make_and_export
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError
from kb.export import pair_layouts
from tests.pairs.made import fill, shards, tables

# MineDojo's published pairs: {keyword: [[video_id, start, end], …]}
MINEDOJO = {
    "type": "object",
    "minProperties": 1,
    "additionalProperties": {
        "type": "array",
        "minItems": 1,
        "items": {
            "type": "array",
            "minItems": 3,
            "maxItems": 3,
            "prefixItems": [
                {"type": "string", "minLength": 1},
                {"type": "number", "minimum": 0},
                {"type": "number", "exclusiveMinimum": 0},
            ],
        },
    },
}


@pytest.fixture(scope="module")
def run(tmp_path_factory, make_rows) -> Run:
    root = tmp_path_factory.mktemp("layouts")
    fill(root, *tables(30, 300, ["creeper", "oak log", "iron golem"], share=0.05), make_rows)
    return Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=1)


def _export(run: Run, layout: str) -> Path:
    return Path(make_and_export(run, "pairs", layout)["export"])


def _pairs(run: Run) -> list[dict]:
    return pq.read_table(shards(run.root / "pairs")).to_pylist()


def test_minedojo(run: Run) -> None:
    path = _export(run, "minedojo")
    assert path == run.root / "export" / "minedojo" / "pairs.json"
    data = json.loads(path.read_text())
    jsonschema.validate(data, MINEDOJO)
    flat = {(keyword, *clip) for keyword, clips in data.items() for clip in clips}
    assert flat == {
        (row["keyword"], row["video_id"], row["clip_start_s"], row["clip_end_s"])
        for row in _pairs(run)
    }


def test_without_pairs_there_is_nothing_to_export(run: Run, tmp_path: Path) -> None:
    with pytest.raises(FatalError, match="nothing to export"):
        pair_layouts.video2dataset(replace(run, root=tmp_path / "none"))


@pytest.mark.parametrize("layout", ["minedojo", "video2dataset"])
def test_a_damaged_index_is_made_again(run: Run, tmp_path: Path, layout: str) -> None:
    _export(run, "minedojo")
    other = replace(run, root=tmp_path / "a#b?c[d]*'e")
    shutil.copytree(run.root, other.root)
    (part,) = shards(other.root / "pairs")
    whole = part.read_bytes()
    part.write_bytes(whole[:100])
    _export(other, layout)
    assert part.read_bytes() == whole


@pytest.mark.parametrize("table", ["videos", "transcripts"])
def test_damaged_rows_of_youtube_are_named(run: Run, tmp_path: Path, table: str) -> None:
    other = replace(run, root=tmp_path)
    shutil.copytree(run.root / "clean", other.root / "clean")
    part = min((other.root / "clean" / "youtube" / table).glob("*.parquet"))
    part.write_bytes(part.read_bytes()[:500])
    with pytest.raises(DamagedData, match=f"{table}/{part.name} can't be read") as caught:
        _export(other, "video2dataset")
    assert caught.value.hint == "run `kb youtube filter` again"


def test_video2dataset_reads_the_clips(run: Run, tmp_path: Path) -> None:
    """By video2dataset's own reader; its package imports its downloaders,
    so the module is loaded alone.
    """
    path = _export(run, "video2dataset")
    found = importlib.util.find_spec("video2dataset")
    if found is None:
        pytest.skip("video2dataset is not installed (pip install --no-deps video2dataset==1.3.0)")
    file = Path(next(iter(found.submodule_search_locations or [])), "input_sharder.py")
    spec = importlib.util.spec_from_file_location("v2d_input_sharder", file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    reader = module.InputSharder(
        str(path),
        "parquet",
        "url",
        "caption",
        "clips",
        ["video_id", "pair_id"],
        7,
        set(),
        str(tmp_path),
    )
    rows = [row for file, _ in reader for row in pa.ipc.open_file(file).read_all().to_pylist()]
    pairs = _pairs(run)
    assert [row["url"] for row in rows] == [
        f"https://www.youtube.com/watch?v={row['video_id']}" for row in pairs
    ]
    # Its downloader gives a row's caption to each clip of the row: so a row has one clip, its own.
    assert [(row["pair_id"], row["clips"], row["caption"]) for row in rows] == [
        (row["pair_id"], [[row["clip_start_s"], row["clip_end_s"]]], row["text"]) for row in pairs
    ]


def test_a_folder_is_complete_once_it_is_made(run: Run) -> None:
    _export(run, "video2dataset")
    assert freshness.reasons(run, "export/video2dataset") == []


def test_video2dataset_can_download_each_video_once(run: Run) -> None:
    videos = pq.read_table(_export(run, "video2dataset").with_name("videos.parquet")).to_pylist()
    pairs = _pairs(run)
    assert [row["video_id"] for row in videos] == sorted({row["video_id"] for row in pairs})
    clips = [clip for row in videos for clip in zip(row["pair_id"], row["clips"], strict=True)]
    assert clips == [(row["pair_id"], [row["clip_start_s"], row["clip_end_s"]]) for row in pairs]
