"""Every folder that a command makes is declared once, and found by its path."""

from pathlib import Path

import pytest

from kb.store.artifact_registry import ARTIFACTS, RELEASE, artifact_of, of_table
from kb.store.damage import remedy


@pytest.mark.parametrize("name", sorted(ARTIFACTS.keys() - {RELEASE}))
def test_a_path_below_an_artifact_leads_to_it(name: str) -> None:
    for root in (Path("/data"), Path("/pairs/data"), Path("relative")):
        assert artifact_of(root / name / "part-00000.parquet") == (root, ARTIFACTS[name])


def test_other_paths_belong_to_no_artifact() -> None:
    assert artifact_of(Path("/data/raw/youtube/videos/x.ndjson.zst")) is None


def test_inputs_are_artifacts_or_raw_data() -> None:
    for artifact in ARTIFACTS.values():
        assert all(one in ARTIFACTS or one.startswith("raw/") for one in artifact.inputs)


@pytest.mark.parametrize(
    ("table", "name"),
    [
        ("youtube/videos", "clean/youtube"),
        ("wiki/rejected", "clean/wiki"),
        ("pairs/pairs", "pairs"),
        ("links/entities", "links"),
    ],
)
def test_a_table_belongs_to_an_artifact(table: str, name: str) -> None:
    assert of_table(table) is ARTIFACTS[name]


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("clean/youtube/videos/part-0.parquet", "run `kb youtube filter` again"),
        (
            "clean/pairs/release/raw/clean/reddit/posts/part-0.parquet",
            "run `kb reddit filter` again",
        ),
        ("pairs/pairs-00000-of-00001.parquet", "run `kb pairs --again`"),
        ("release/pairs/pairs-00000-of-00001.parquet", "run `kb pairs --again`"),
        ("release/wiki/pages-00000-of-00001.parquet", "run `kb wiki export` again"),
        ("export/text/reddit.jsonl", "run `kb reddit export --format text` again"),
        (
            "annotations/reddit/toxicity.parquet",
            "remove it, then run `kb reddit filter`, which scores its texts again",
        ),
        (
            "raw/youtube/tombstones.parquet",
            "restore it from a copy: without it, purged content would return",
        ),
        ("raw/youtube/videos/000001.ndjson.zst", "restore it from a copy"),
    ],
)
def test_how_a_file_is_made_again(path: str, hint: str, tmp_path: Path) -> None:
    (tmp_path / "pairs/state").mkdir(parents=True)
    assert remedy(tmp_path / "pairs" / path) == hint


@pytest.mark.parametrize("name", ["release/wiki", "wiki", "download/pairs"])
def test_a_file_of_a_download_is_downloaded_again(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir(parents=True)
    (folder / "SHA256SUMS").touch()
    shard = folder / "pages-00000-of-00001.parquet"
    assert remedy(shard) == "download it again, into the same folder"
