"""`kb demo` of the installed wheel, outside of the checkout:
the whole job, and nothing left out.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from kb.core.sources import BY_DEFAULT
from tests import processes, trap
from tests.cli.conftest import clean_environment
from tests.installed import outside

pytestmark = pytest.mark.wheel

STEPS = [
    "youtube crawl",
    "youtube filter",
    "youtube export",
    "wiki crawl",
    "wiki filter",
    "wiki export",
    "reddit crawl",
    "reddit import",
    "refresh reddit",
    "reddit filter",
    "reddit export",
    "reddit reconstruct",
    "pairs",
    "links",
    "index",
    "release",
    "report",
]


# What a user's own settings may be, and what the demo must leave alone: two credentials, hosts and
# a model that are not there.
OWN_DOTENV = """\
YOUTUBE_API_KEY=a-real-key
KB_YOUTUBE_ENDPOINT=https://192.0.2.1
KB_WIKI_URL=https://192.0.2.1
"""
OWN_ENVIRONMENT = {
    "REDDIT_CLIENT_SECRET": "a-real-secret",
    "KB_REDDIT_ENDPOINT": "http://192.0.2.1",
    "KB_TOXICITY_MODEL": "/nowhere",
}


WATCHED = """\
"$BIN/kb" demo --json > demo.out
cp -r data/demo demo.again
unset KB_REDDIT_ENDPOINT
model="from kb.sandbox.toxicity import tiny_checkpoint; print(tiny_checkpoint())"
export KB_DATA=demo.again KB_TOXICITY_MODEL="$("$BIN/python" -c "$model")"
"$BIN/kb" reddit filter --workers 2 --json
"""


@pytest.fixture(scope="module")
def demo(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the installed `kb demo` was run: its data/demo, and what it printed in
    demo.out and demo.err.

    The user's own settings, in .env and in the environment, are such as no demo could be done with.
    Every address but loopback is a trap: what any process tried is in demo.attempts. As so small a
    demo starts no workers, a filter of a copy is done by two.
    """
    folder = tmp_path_factory.mktemp("demo")
    (folder / ".env").write_text(OWN_DOTENV)
    (folder / "demo.sh").write_text(WATCHED)
    home = folder / ".home"
    home.mkdir()
    with (folder / "demo.err").open("w") as err:
        code = trap.run(
            ["bash", "-e", "demo.sh"],
            folder / "demo.attempts",
            outside() | OWN_ENVIRONMENT | {"HOME": str(home), "BIN": str(installed)},
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=err,
        )
    assert code == 0, (folder / "demo.err").read_text()[-3000:]
    return folder


def summary(demo: Path) -> dict[str, object]:
    return json.loads((demo / "demo.out").read_text().splitlines()[-1])


def test_every_step_was_done(demo: Path) -> None:
    done = summary(demo)
    assert [name for name in done if name in STEPS] == STEPS
    for step in STEPS:
        assert "left_out" not in done[step], done[step]
    assert Path(done["root"]) == demo / "data" / "demo"
    assert done["youtube filter"]["crawled"] == 300


def test_the_output_fits_on_a_page(demo: Path) -> None:
    lines = (demo / "demo.out").read_text().splitlines()
    assert len(lines) < 80
    assert [line for line in lines if line.startswith("youtube filter: 300 videos crawled")]


def test_the_users_own_settings_and_credentials_are_left_alone(demo: Path) -> None:
    for path in demo.rglob("*"):
        assert path.name == ".env" or not path.is_file() or b"a-real-" not in path.read_bytes(), (
            path
        )


def test_no_process_tries_any_address_but_loopback(demo: Path) -> None:
    """The browser's processes, workers and whatever the libraries start included."""
    assert trap.attempts(demo / "demo.attempts") == []


def test_nothing_is_lost_on_the_way(demo: Path) -> None:
    done = summary(demo)
    for source in ("youtube", "wiki", "reddit"):
        found = done[f"{source} filter"]
        assert (
            found["crawled"]
            == found["kept"] + found["rejected"] + found["failed"] + found["pending"]
        )
        assert (found["failed"], found["pending"]) == (0, 0)
        assert found["kept"] > 0
        assert found["rejected"] > 0 or source == "wiki", "every page of the wiki is kept"


def test_it_leaves_what_the_contract_says(demo: Path) -> None:
    root = demo / "data" / "demo"
    for source in ("youtube", "wiki", "reddit"):
        for folder in ("raw", "clean", "annotations", "release", "index"):
            assert any((root / folder / source).rglob("*.*")), f"{folder}/{source}"
        assert (root / "state" / f"{source}.sqlite").is_file()
    for source in BY_DEFAULT:
        for name in (
            "README.md",
            "croissant.json",
            "zenodo.json",
            "SHA256SUMS",
            "LICENSE",
            "CITATION.cff",
            "DATASHEET.md",
        ):
            assert (root / "release" / source / name).is_file(), f"release/{source}/{name}"
    page = (root / "report" / "index.html").read_text()
    assert page.count("All data here are invented") == 1
    assert [path.name for path in demo.iterdir() if not path.name.startswith(("demo.", "."))] == [
        "data"
    ], "nothing else beside the data"


def test_it_prints_queries_with_results(demo: Path) -> None:
    out = (demo / "demo.out").read_text()
    assert out.count("\nkb query ") >= 3
    assert re.search(r"^kb search .*\n 1\. ", out, re.MULTILINE)
    said = (demo / "demo.err").read_text()
    assert "Traceback" not in said
    assert "leaked" not in said  # nothing of DuckDB's outlives the interpreter


def test_its_status_fits_on_a_screen(demo: Path, tmp_path: Path) -> None:
    """Without a key, of which there is one in the demo's folder."""
    words = ["status", "--data", str(demo / "data" / "demo")]
    done = processes.run(words, env=clean_environment(), cwd=tmp_path)
    lines = done.stdout.splitlines()
    assert len(lines) <= 20, done.stdout
    assert lines[-1] == "nothing is left to do"
    assert "quota" not in done.stdout


@pytest.mark.parametrize("source", BY_DEFAULT)
def test_its_release_is_read_by_everyone(
    demo: Path, source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows by DuckDB, polars, Hugging Face datasets and mlcroissant are the same;
    checksums and citation are good.
    """
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    import datasets
    import duckdb
    import mlcroissant
    import polars

    folder = demo / "data" / "demo" / "release" / source
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=folder, check=True)
    subprocess.run(
        [Path(sys.executable).with_name("cffconvert"), "--validate"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    described = mlcroissant.Dataset(str(folder / "croissant.json"))
    for name in datasets.get_dataset_config_names(str(folder)):
        files = f"{folder}/{name}-0*.parquet"
        rows = (
            duckdb.connect().execute("SELECT count(*) FROM read_parquet(?)", [files]).fetchone()[0]
        )
        assert rows > 0
        assert len(polars.read_parquet(files)) == rows
        assert (
            datasets.load_dataset(
                str(folder), name, cache_dir=str(tmp_path), split="train"
            ).num_rows
            == rows
        )
        assert sum(1 for _ in described.records(name)) == rows
