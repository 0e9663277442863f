"""Every folder that a command makes is declared once, and found by its path."""

from __future__ import annotations

from pathlib import Path

import pytest

from kb.artifacts.registry import ARTIFACTS, artifact_of, of_table


@pytest.mark.parametrize("name", ARTIFACTS)
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
