"""`kb links` on a data root: the same bytes however it is worked on; what follows it."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb
from kb import query
from kb.artifacts import manifest
from kb.artifacts.makers import make_and_export
from kb.core.config.pipeline import Recipe
from kb.core.context import Run
from kb.core.errors import WriterLocked
from kb.core.progress import Progress
from kb.links import build as building
from kb.query import connect
from kb.schema import table
from kb.schema.wiki_page import PageNames
from kb.search.answers import keys
from kb.store import lock
from kb.store.artifact_registry import MANIFEST
from kb.store.layout import Layout, parquet_files
from kb.store.tables import parquet, shard_writer
from kb.store.tables.shard_writer import write_table
from kb.verify.root import verify
from tests.inprocess import Here
from tests.links import made

NAMES = {"Canidae": PageNames("Canidae", ("Wolf",))}
SECRET = "video000002"


def bytes_of(root: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((root / "links").iterdir())}


def test_the_tables(run: Run) -> None:
    summary = made.links(run, NAMES)
    found = made.rows(run.root)
    entities = {row["entity"]: row for row in made.rows(run.root, "entities")}
    assert list(entities) == sorted(entities)
    assert entities["Wolf"] == {
        "entity": "Wolf",
        "kind": "entity",
        "aliases": ["hound", "hounds", "wolfie", "wolfies", "wolves"],
        "wiki_page_id": 11,
    }
    assert entities["Creeper"]["wiki_page_id"] == 10
    assert entities["Oak"]["wiki_page_id"] is None
    assert [row for row in found if row["entity"] == "Wolf" and row["source"] == "wiki"] == [
        _row("Wolf", "11", "page", "mention", 2),
        _row("Wolf", "11", "title", "alias", 1),
    ]
    spoken = [row for row in found if (row["entity"], row["key"]) == ("Ender Dragon", SECRET)]
    assert [(row["part"], row["count"], row["first_at_s"]) for row in spoken] == [
        ("transcript", 1, 3.8)
    ]
    keys = [tuple(row[name] for name in table("links/links").key) for row in found]
    assert keys == sorted(set(keys))
    assert summary["entities"] == len(entities) == 9
    assert summary["with_page"] == 2
    assert summary["sources"] == {
        source: sum(row["source"] == source for row in found)
        for source in ("youtube", "wiki", "reddit")
    }
    assert not list(run.root.glob("links/.*"))


def _row(entity: str, key: str, part: str, how: str, count: int) -> dict[str, Any]:
    about = {"entity": entity, "source": "wiki", "key": key, "part": part, "how": how}
    ids = {"video_id": None, "page_id": int(key), "post_id": None, "comment_id": None}
    return {**about, **ids, "count": count, "first_at_s": None}


def test_ids_are_those_of_the_tables_of_their_source(run: Run) -> None:
    made.links(run, NAMES)
    with query.connect(run.root) as db:
        for source, table_, ids in (
            ("youtube", "youtube_videos", {"video_id"}),
            ("wiki", "wiki_pages", {"page_id"}),
            ("reddit", "reddit_posts", {"post_id"}),
            ("comment", "reddit_comments", {"post_id", "comment_id"}),
        ):
            which = "part = 'comment'" if source == "comment" else f"source = '{source}'"
            of = f"FROM links WHERE {which} AND (part = 'comment') = ('{source}' = 'comment')"
            rows = db.sql(f"SELECT * {of}").to_arrow_table().to_pylist()
            assert rows
            for name in ("video_id", "page_id", "post_id", "comment_id"):
                assert {row[name] is not None for row in rows} == {name in ids}
            joined = db.sql(
                f"SELECT count(*) FROM (SELECT * {of}) JOIN {table_} USING ({', '.join(ids)})"
            )
            assert joined.fetchall() == [(len(rows),)]


def cut(folder: Path, name: str, parts: int) -> None:
    """A clean table spread over more files."""
    (path,) = parquet_files(folder)
    held = parquet.read_table(path)
    path.unlink()
    for part in range(parts):
        rows = held.take(pa.array(range(part, held.num_rows, parts), pa.int64()))
        write_table(folder / f"part-{part:05d}.parquet", rows, name)


def test_workers_and_file_layout_change_no_byte_of_the_tables(run: Run) -> None:
    made.links(run, NAMES)
    first = bytes_of(run.root)
    for name in ("youtube/videos", "youtube/transcripts", "wiki/pages", "reddit/comments"):
        cut(Layout(run.root).table(name), name, 3)
    made.links(replace(run, workers=2), NAMES)
    second = bytes_of(run.root)
    assert second.pop(MANIFEST) != first.pop(MANIFEST)  # it has digests of the texts
    assert second == first


def test_links_are_made_again_only_of_other_texts(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    made.links(run, NAMES)
    with monkeypatch.context() as patch:
        patch.setattr(building, "make_part", None)  # nothing is read again
        made.links(run, NAMES)
    made.fill(run.root, comments=["wolf"], posts=[("Creeper", "", [])])
    made.links(run, NAMES)
    assert any(row["source"] == "reddit" for row in made.rows(run.root))
    # A source whose clean tables are gone leaves the links too.
    shutil.rmtree(run.root / "clean" / "wiki")
    made.links(run)
    assert {row["source"] for row in made.rows(run.root)} == {"youtube", "reddit"}
    assert all(row["wiki_page_id"] is None for row in made.rows(run.root, "entities"))


def test_a_lost_or_damaged_file_is_told_and_mended(run: Run) -> None:
    made.links(run, NAMES)
    (path,) = Layout(run.root).rows("links/entities")
    path.unlink()
    assert [(one.kind, one.state, one.path) for one in verify(run.root, Progress()).entries] == [
        ("links", "missing", path)
    ]
    made.links(run, NAMES)
    assert not verify(run.root, Progress()).entries
    path.write_bytes(path.read_bytes()[:-40])
    (one,) = verify(run.root, Progress()).entries
    assert (one.kind, one.state, one.advice) == ("links", "damaged", "run `kb links --again`")
    said = Recipe("verify").defined("repair")(run)[1]
    assert said == ["links was made again"]
    assert not verify(run.root, Progress()).entries


def test_one_writer_and_no_filter_meanwhile(run: Run) -> None:
    """A filter of any source changes what links are made of."""
    with lock.taking(run.root, "links"):
        assert all("links" in lock.of_clean(source) for source in ("youtube", "wiki", "reddit"))
        made.links(run, NAMES)  # its own step
    code = os.fork()
    if not code:
        with lock.writer(run.root, "links"):
            try:
                made.links(run, NAMES)
            except WriterLocked:
                os._exit(7)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(code, 0)[1]) == 7


def test_every_pair_has_its_link(run: Run) -> None:
    make_and_export(run, "pairs")
    made.links(run, NAMES)
    with connect(run.root) as con:
        pairs = con.execute("SELECT count(*) FROM pairs").fetchone()
        joined = con.execute(
            """SELECT count(*), min(match_start_s - first_at_s), max(count)
            FROM pairs JOIN links.links ON key = pairs.video_id AND entity = keyword
            WHERE part = 'transcript'"""
        ).fetchone()
    assert pairs is not None
    assert joined is not None
    assert joined[0] == pairs[0] > 5
    assert joined[1] == 0  # never later than the pair, and the first pair's own second


def test_status_tells_that_links_are_older(run: Run, here: Here) -> None:
    at = ("--data", str(run.root), "--profile", str(run.profile.path))
    assert "made of them" not in here("status", *at).out
    assert here("links", *at).code == 0
    assert "made of them: 9 entities, " in here("status", *at).out
    for path in run.root.rglob("*.parquet"):
        os.utime(path, (1, 1))  # a copy: times say nothing
    assert "links" not in stale(here, *at)
    made.fill(run.root, comments=["a dragon and a creeper"], posts=[("Dragon", "", [])])
    assert stale(here, *at)["links"] == ["clean/reddit"]
    assert "\n  links: clean/reddit\n" in here("status", *at).out
    assert here("links", *at).code == 0
    assert "links" not in stale(here, *at)


def stale(here: Here, *at: str) -> dict[str, list[str]]:
    """What `kb status` calls out of date, with its reasons."""
    found = json.loads(here("status", "--json", *at).out)["stale"]
    return {one["artifact"]: one["reasons"] for one in found}


def test_queries_and_what_makes_the_tables(run: Run, here: Here) -> None:
    at = ("--data", str(run.root), "--profile", str(run.profile.path))
    done = here("query", "FROM links.links", *at)
    assert done.code != 0
    assert "`kb links --data " in done.err
    assert " makes it" in done.err
    assert here("links", *at).code == 0
    sql = "SELECT kind FROM links.links JOIN links.entities USING (entity) WHERE key = 't1_c0'"
    assert here("query", sql, "--format", "csv", *at).out.splitlines() == ["kind", "entity"]
    listed = here("query", "--tables", *at).out
    assert "links.entities" in listed
    assert "release.links" in listed
    assert "clean.links" not in listed


def test_leftovers_of_a_killed_run_go_with_the_next(run: Run) -> None:
    made.links(run, NAMES)
    left = [
        run.root / ".links.new" / "links-00000-of-00001.parquet",
        run.root / "links" / ".links-00000-of-00001.parquet.1-2-abc.tmp",
    ]
    for path in left:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(SECRET)
    made.links(run, NAMES)
    assert not [path for path in left if path.exists()]


def test_keys_are_found_in_any_row_group(run: Run, tmp_path: Path) -> None:
    made.links(run, NAMES)
    (path,) = Layout(run.root).rows("links/links")
    small = shard_writer.sorted_shards([path], tmp_path, "links/links", group_rows=4)
    small[0].path.replace(path)
    manifest.record(path.parent, "links")
    assert pq.read_metadata(path).num_row_groups > 8
    sources = ["youtube", "reddit"]
    for row in made.rows(run.root, "entities"):
        name = row["entity"]
        mine = [one for one in made.rows(run.root) if one["entity"] == name]
        assert keys(run.root, name, sources) == {
            source: sorted({one["key"] for one in mine if one["source"] == source})
            for source in sources
        }


def test_a_search_within_what_names_an_entity(run: Run, here: Here) -> None:
    at = ("--data", str(run.root), "--profile", str(run.profile.path))
    asked = ("search", "creeper", "--entity", "dragon", "--all", "--limit", "50", "--json", *at)
    done = here(*asked)
    assert done.code == 2
    assert "there are no entity tables" in done.err
    assert "run `kb links --data " in done.err
    assert here("links", *at).code == 0
    found = json.loads(here(*asked).out.splitlines()[-1])["answers"]
    linked = {row["key"] for row in made.rows(run.root) if row["entity"] == "Ender Dragon"}
    assert {one["key"] for one in found} == {made.video_id(n) for n in range(6)}
    assert {one["key"] for one in found} < linked  # "dragon" is another of its forms
    every = json.loads(here("search", "creeper", *asked[4:]).out.splitlines()[-1])["answers"]
    scores = {(one["key"], one["text"]): one["score"] for one in every}
    assert len(every) > len(found)  # and the same scores
    assert all(one["score"] == scores[one["key"], one["text"]] for one in found)
    data = kb.load(run.root)
    answers = data.search("creeper", entity="Ender Dragon", source="youtube", each=None, limit=50)
    assert {row["key"] for row in answers.to_pylist()} == {one["key"] for one in found}
    done = here("search", "creeper", "--entity", "ender dargon", *at)
    assert done.code == 2
    assert "no entity 'ender dargon'; did you mean Ender Dragon?" in done.err
    # What was filtered since is not linked: that is said, and no answer is left out in silence.
    made.fill(run.root, comments=["a dragon and a creeper"], posts=[("Dragon", "", [])])
    done = here(*asked)
    assert done.code == 2
    assert "are older than the texts of reddit" in done.err
