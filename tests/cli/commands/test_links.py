"""Tests of `kb links` at the command line."""

import json

import pyarrow as pa
import pyarrow.parquet as pq

import kb
from kb.core.context import Run
from kb.release.build import release
from kb.store.tables.shard_writer import write_table
from tests.inprocess import Here
from tests.links import made
from tests.links.conftest import run  # noqa: F401  a fixture


def test_the_release_has_ids_and_counts(run: Run, here: Here) -> None:  # noqa: F811
    at = ("--data", str(run.root), "--profile", str(run.profile.path))
    done = here("links", "--json", *at)
    assert done.code == 0, done.err
    assert json.loads(done.out.splitlines()[-1])["release"] == str(run.root / "release" / "links")
    summary = release(run)
    assert summary["sources"] == {
        "links": {"entities": 9, "links": len(made.rows(run.root))},
    }
    folder = run.root / "release" / "links"
    held = pq.read_table(next(folder.glob("links-*.parquet")))
    assert held.to_pylist() == made.rows(run.root)
    texts = {path.name: path.read_text() for path in folder.iterdir() if path.suffix != ".parquet"}
    for said in ("near an oak", "the wolf and the dragon", "chest wolf"):
        assert not any(said in text for name, text in texts.items() if "sample" in name)
        assert not any(said.encode() in path.read_bytes() for path in folder.glob("*.parquet"))
    assert "What is named in most places" in texts["README.md"]
    data = kb.load(folder)
    assert {"entities", "links"} <= set(data.tables)
    assert data.sql("SELECT sum(count) AS n FROM links").to_pylist() == [
        {"n": sum(row["count"] for row in made.rows(run.root))}
    ]
    # What was filtered since is not to be published by what names it.
    made.fill(run.root, comments=["a wolf"], posts=[("Dragon", "", [])])
    done = here("release", *at)
    assert done.code == 1
    assert "links: are older than clean/reddit" in done.err
    assert here("links", *at).code == here("release", *at).code == 0
    held = pq.read_table(next(folder.glob("links-*.parquet")))
    # A text in a column is refused.
    rows = held.set_column(2, "key", pa.array(["a wolf and a bed"] * held.num_rows))
    write_table(next(folder.glob("links-*.parquet")), rows, "links/links", released=True)
    assert here("release", *at).code == 1
