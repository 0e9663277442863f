"""A published release, downloaded from the loopback service into an empty folder, read by everyone
who will read it.

Offline: DuckDB, pyarrow, polars, Hugging Face datasets, mlcroissant, sha256sum, cffconvert,
zenodo.json.
"""

import json
import os
import re
import shutil
import subprocess
from datetime import datetime
from pathlib import Path
from typing import Any

import duckdb
import numpy
import polars
import pyarrow.parquet as pq
import pytest

import kb
from kb.schema import tables
from tests.conftest import skip_or_fail
from tests.recipes import release
from tests.release.conftest import SOURCES, TABLES, a_run
from tests.release.made import build, rows


def shards(folder: Path, name: str) -> str:
    source, _, table = name.partition("/")
    return str(folder / source / f"{table}-*-of-*.parquet")


@pytest.mark.parametrize("source", SOURCES)
def test_sha256sum(downloaded: Path, source: str) -> None:
    done = subprocess.run(
        ["sha256sum", "-c", "--strict", "SHA256SUMS"],
        cwd=downloaded / source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    listed = {line.partition(":")[0] for line in done.stdout.splitlines()}
    assert listed == {path.name for path in (downloaded / source).iterdir()} - {"SHA256SUMS"}


@pytest.mark.parametrize("name", TABLES)
def test_duckdb(downloaded: Path, expected: dict[str, int], name: str) -> None:
    key = ", ".join(tables()[name].key)
    found = (
        duckdb.connect()
        .execute(
            f"SELECT count(*), count(DISTINCT ({key})) FROM read_parquet(?)",
            [shards(downloaded, name)],
        )
        .fetchone()
    )
    assert found == (expected[name], expected[name])


def test_kb_query(released: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from kb.cli import main

    with pytest.raises(SystemExit) as left:
        main(
            [
                "query",
                (
                    "SELECT v.video_id, count(*) AS n FROM release.youtube_videos v"
                    " JOIN release.pairs p USING (video_id) GROUP BY 1 ORDER BY 1 LIMIT 1"
                ),
                "--data",
                str(released),
                "--format",
                "json",
            ]
        )
    assert not left.value.code
    assert '"vid00000000"' in capsys.readouterr().out


@pytest.mark.parametrize("name", TABLES)
def test_pyarrow_finds_types_nulls_and_descriptions(
    downloaded: Path, expected: dict[str, int], name: str
) -> None:
    import pyarrow.dataset as ds

    files = sorted(Path(shards(downloaded, name)).parent.glob(Path(shards(downloaded, name)).name))
    found = ds.dataset([str(file) for file in files])
    assert found.count_rows() == expected[name]
    schema = pq.read_schema(files[0])
    assert schema.equals(tables()[name].arrow(True))
    for column in tables()[name].columns:
        if column.released:
            assert schema.field(column.name).metadata[b"doc"].decode() == column.doc
            assert schema.field(column.name).nullable == column.nullable


@pytest.mark.parametrize("name", TABLES)
def test_polars(downloaded: Path, expected: dict[str, int], name: str) -> None:
    polars = pytest.importorskip("polars")
    assert polars.read_parquet(shards(downloaded, name)).height == expected[name]


@pytest.fixture(scope="module")
def datasets(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setenv("HF_HOME", str(tmp_path_factory.mktemp("hf")))
        patch.setenv("HF_DATASETS_CACHE", str(tmp_path_factory.mktemp("hf-cache")))
        yield pytest.importorskip("datasets")


@pytest.mark.parametrize("name", TABLES)
def test_hugging_face_datasets(
    downloaded: Path, expected: dict[str, int], datasets: Any, name: str
) -> None:
    source, _, table = name.partition("/")
    found = datasets.load_dataset(
        str(downloaded / source), table, split="train", cache_dir=os.environ["HF_DATASETS_CACHE"]
    )
    assert found.num_rows == expected[name]
    assert found.column_names == tables()[name].names(released=True)


def test_hugging_face_datasets_forgets_purged_rows(tmp_path: Path, datasets: Any) -> None:
    """Its cache knows a folder by name and by the card's front matter."""
    for count in (60, 59):
        root = build(tmp_path / "root", sources=("youtube",), n=count)
        release(a_run(root))
        found = datasets.load_dataset(
            str(root / "release/youtube"), "videos", split="train", cache_dir=str(tmp_path / "hf")
        )
        assert found.num_rows == count
        shutil.rmtree(root)


def test_hugging_face_reads_the_front_matter(downloaded: Path) -> None:
    hub = pytest.importorskip("huggingface_hub")
    for source in SOURCES:
        data = hub.DatasetCard.load(downloaded / source / "README.md").data
        assert isinstance(data, hub.DatasetCardData)
        named = [one["config_name"] for one in data.configs]
        assert named == [name.partition("/")[2] for name in TABLES if name.startswith(f"{source}/")]
        info = data.to_dict()["dataset_info"]
        for one in info if isinstance(info, list) else [info]:
            (split,) = one["splits"]
            files = sorted((downloaded / source).glob(f"{one['config_name']}-*-of-*.parquet"))
            assert split["num_bytes"] == sum(path.stat().st_size for path in files)
            assert split["num_examples"] == sum(pq.read_metadata(one).num_rows for one in files)


def test_card_names_licence_tags_and_one_default(downloaded: Path) -> None:
    yaml = pytest.importorskip("yaml")
    for source in SOURCES:
        text = (downloaded / source / "README.md").read_text(encoding="utf-8")
        front = yaml.safe_load(text.split("---")[1])
        assert front["license"] == ("cc-by-nc-sa-3.0" if source == "wiki" else "cc-by-4.0")
        assert sum(bool(config.get("default")) for config in front["configs"]) == 1
        for declared in tables().values():
            if declared.source == source and declared.released:
                assert all(f"| `{name}` |" in text for name in declared.names(released=True))


@pytest.mark.parametrize("source", SOURCES)
def test_cffconvert(downloaded: Path, source: str) -> None:
    command = shutil.which(
        "cffconvert", path=f"{Path(__import__('sys').executable).parent}:{os.environ['PATH']}"
    )
    if command is None:
        skip_or_fail("cffconvert is not installed")
    valid = subprocess.run(
        [command, "--validate", "-i", "CITATION.cff"],
        cwd=downloaded / source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert valid.returncode == 0, valid.stdout + valid.stderr


@pytest.mark.parametrize("source", SOURCES)
def test_a_sample_of_rows_that_belong_together(downloaded: Path, source: str) -> None:
    samples = sorted((downloaded / source).glob("*.sample.json"))
    assert [path.name.removesuffix(".sample.json") for path in samples] == [
        name.partition("/")[2] for name in TABLES if name.startswith(f"{source}/")
    ]
    for path in samples:
        short = path.name.partition(".")[0]
        rows = polars.read_json(path)
        whole = polars.read_parquet(downloaded / source / f"{short}-*-of-*.parquet")
        assert rows.columns == whole.columns
        assert 0 < rows.height <= whole.height
        first = json.loads(path.read_text(encoding="utf-8"))[0]
        key = whole.columns[0]
        same = whole.filter(polars.col(key) == first[key]).to_dicts()
        assert any(_as_json(row) == first for row in same)
    if source == "wiki":
        pages, elements = (
            set(polars.read_json(downloaded / "wiki" / f"{name}.sample.json")["page_id"])
            for name in ("pages", "elements")
        )
        assert pages == elements


def _as_json(row: dict[str, Any]) -> dict[str, Any]:
    """A row as JSON has it: times in ISO 8601, 32-bit numbers by their own digits."""
    return {
        name: value.isoformat().replace("+00:00", "Z")
        if isinstance(value, datetime)
        else float(str(numpy.float32(value)))
        if name.startswith("toxicity") and value is not None
        else value
        for name, value in row.items()
    }


@pytest.mark.parametrize("source", SOURCES)
def test_every_row_comes_once_for_who_reads_all_parquet_files(
    downloaded: Path, source: str
) -> None:
    """Nothing beside the shards is a `*.parquet`."""
    others = {
        path.name
        for path in (downloaded / source).glob("*.parquet")
        if not re.fullmatch(r"[a-z_]+-\d{5}-of-\d{5}\.parquet", path.name)
    }
    assert not others


def test_no_text_of_reddit_or_transcripts_leaves(downloaded: Path) -> None:
    made = rows()
    texts = (
        [row[name] for row in made["reddit/posts"] for name in ("title", "body", "author_hash")]
        + [row["body"] for row in made["reddit/comments"]]
        + [row["text"] for row in made["pairs/pairs"]]
    )
    for source in ("reddit", "pairs"):
        for path in (downloaded / source).glob("*.parquet"):
            values = {
                value
                for column in pq.read_table(path).itercolumns()
                for value in column.to_pylist()
                if isinstance(value, str)
            }
            assert not values & set(texts)


def test_tombstones_have_their_columns_even_without_rows(downloaded: Path) -> None:
    data = kb.load(downloaded)
    for source in SOURCES:
        assert (downloaded / source / "tombstones.ndjson").is_file()
        assert data[f"{source}_tombstones"].schema.names == [
            "key",
            "source",
            "removed_at",
            "reason",
        ]
        assert data.sql(f"SELECT reason, removed_at FROM {source}_tombstones").to_pylist() == []


@pytest.mark.parametrize("source", SOURCES)
def test_datasheet_answers_every_question_with_measured_figures(
    downloaded: Path, source: str
) -> None:
    text = (downloaded / source / "DATASHEET.md").read_text(encoding="utf-8")
    for heading in (
        "Motivation",
        "Composition",
        "Collection process",
        "Preprocessing, cleaning, labeling",
        "Uses",
        "Distribution",
        "Maintenance",
    ):
        assert f"\n## {heading}\n" in text
    questions = [part for part in text.split("\n**")[1:] if "?**" in part]
    assert len(questions) >= 25
    assert all(len(part.partition("?**")[2].strip()) > 5 for part in questions)
    for name, made in rows().items():
        if name.startswith(f"{source}/"):
            assert f"| {name.partition('/')[2]} | {len(made):,} |" in text


def test_the_keyword_list_is_a_plain_table(downloaded: Path) -> None:
    import pandas

    path = downloaded / "pairs" / "keywords.tsv"
    lines = path.read_text(encoding="utf-8").count("\n") - 1
    read = [
        pandas.read_csv(path, sep="\t"),
        polars.read_csv(path, separator="\t"),
        duckdb.read_csv(str(path)).df(),
    ]
    assert [list(one.columns) for one in read] == [["keyword", "kind", "rule", "forms"]] * 3
    assert [len(one) for one in read] == [lines] * 3
