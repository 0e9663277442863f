"""A domain is a profile: the shipped one that is no game goes through the whole demo, from crawl to
release, and an invented one through what a keyword decides. None speaks of another's world.
"""

import json
import re
import shutil
import tarfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb import query
from kb.cli import main
from kb.core.config.profile import load_profile
from kb.pairs import keywords
from kb.pairs.matching import phrase
from kb.sandbox.domain import domain_of
from kb.sandbox.world import World
from tests.conftest import needs
from tests.contract.conftest import Demo, played
from tests.sandbox.domains import GAMES, MINECRAFT, written

needs("torch")


LITTLE = ("wiki crawl", "wiki filter", "wiki export", "reddit crawl", "reddit import")
REST = ("refresh reddit", "reddit filter", "reddit export", "reddit reconstruct")
LAST = ("tasks", "links", "index", "report", "release")


def rows(root: Path, sql: str) -> list[dict[str, Any]]:
    with query.connect(root) as db:
        return query.select(db, sql).read_all().to_pylist()


def texts(folder: Path) -> Iterator[tuple[str, str]]:
    """(where, text) of everything in a release: files, columns of text, what Parquet says."""
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".parquet":
            file = pq.ParquetFile(path)
            schema = file.schema_arrow
            yield f"{path.name} schema", schema.to_string(show_field_metadata=True)
            yield f"{path.name} metadata", repr(schema.metadata)
            for name, values in zip(schema.names, file.read().columns, strict=True):
                yield f"{path.name} {name}", "\n".join(map(str, values.to_pylist()))
        elif path.suffix == ".tar":
            with tarfile.open(path) as tar:
                yield path.name, "\n".join(tar.getnames())
        elif path.is_file():
            yield path.name, path.read_text(encoding="utf-8")


def test_data_in_every_table(cooking: Demo) -> None:
    with query.connect(cooking.root) as db:
        for view in query.find_views(cooking.root):
            (n,) = db.execute(f"SELECT count(*) FROM {view.full}").fetchone() or (0,)
            # The Cookbook has no grids of slots, and its profile names none.
            empty = re.search(r"failed|pending|tombstones|missing|wiki_recipe", view.full)
            assert n or empty, view.full
    names = {view.full for view in query.find_views(cooking.root)}
    assert {
        "clean.youtube_videos", "clean.youtube_transcripts", "clean.youtube_rejected",
        "clean.wiki_pages", "clean.wiki_elements", "clean.wiki_cells", "clean.wiki_images",
        "clean.wiki_rejected", "clean.reddit_posts", "clean.reddit_comments",
        "clean.reddit_rejected", "release.youtube_videos", "release.wiki_pages",
        "release.wiki_elements", "release.wiki_cells", "release.wiki_images",
        "clean.wiki_facts", "clean.wiki_recipes", "release.wiki_facts", "release.wiki_recipes",
        "release.reddit_posts", "release.reddit_comments", "release.pairs",
    } <= names  # fmt: skip


def test_no_word_of_another_domain_in_the_release(cooking: Demo) -> None:
    said = list(texts(cooking.root / "release"))
    assert len(said) > 100
    for where, text in said:
        assert not MINECRAFT.findall(text), where
        assert not GAMES.findall(text), where
    cards = " ".join(text for where, text in said if where == "README.md")
    assert cards.count("Cooking") >= 4


def test_the_report_of_what_was_shown_is_of_the_domain(cooking: Demo) -> None:
    """Everything between crawl and release as well, the sandbox's other label aside."""
    for table in ("youtube_videos", "youtube_transcripts", "wiki_elements", "reddit_comments"):
        text = json.dumps(rows(cooking.root, f"SELECT * FROM clean.{table}"), default=str)
        assert not MINECRAFT.findall(text), table


def test_thresholds_change_in_the_demos_root_without_another_word(
    cooking: Demo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No model is named, none is fetched, no text is scored anew."""
    monkeypatch.delenv("KB_TOXICITY_MODEL", raising=False)
    root, given = tmp_path / "demo", tmp_path / "profile"
    shutil.copytree(cooking.root, root)
    shutil.copytree(load_profile("cooking").resolve_file("."), given)
    path = given / "profile.toml"
    path.write_text(re.sub(r"(?m)^min_views = \S+", "min_views = 10_000", path.read_text()))
    before = rows(root, "SELECT count(*) AS n FROM clean.youtube_videos")[0]["n"]
    assert called("youtube", "filter", "--data", str(root)) == 0
    assert rows(root, "SELECT count(*) AS n FROM clean.youtube_videos")[0]["n"] == before
    assert called("youtube", "filter", "--data", str(root), "--profile", str(path)) == 0
    kept = rows(root, "SELECT min(view_count) AS least, count(*) AS n FROM clean.youtube_videos")[0]
    assert kept["least"] >= 10_000
    assert 0 < kept["n"] < before


def check_pairs(root: Path, profile: str) -> None:
    """Each pair's text holds a form of its keyword, which is one of the list."""
    loaded = load_profile(profile)
    known = keywords.load(loaded)
    forms: dict[str, set[str]] = {}
    for text, index in zip(known.phrases, known.of, strict=True):
        if index >= 0:
            forms.setdefault(known.every[index].name, set()).add(text)
    pairs = rows(root, "SELECT keyword, text FROM clean.pairs")
    assert len(pairs) > 50
    for pair in pairs:
        said = f" {phrase(pair['text'])} "
        assert any(f" {form} " in said for form in forms[pair["keyword"]]), pair
    assert len({pair["keyword"] for pair in pairs}) >= 10


def check_verdicts(root: Path, profile: str) -> None:
    """Every planted video ends at its stage, with its evidence where it is kept."""
    world = World(domain=domain_of(load_profile(profile)), n_channels=9, n_videos=60)
    found = {
        row["key"]: (row["stage"], row["evidence"])
        for row in rows(
            root,
            """SELECT video_id AS key, NULL AS stage, topic_evidence AS evidence
            FROM clean.youtube_videos
            UNION ALL SELECT key, stage, NULL FROM clean.youtube_rejected""",
        )
    }
    wrong = Counter()
    for video in world.youtube.videos.values():
        case = video.case
        if found[video.id] != (case.stage, None if case.stage else case.evidence):
            wrong[case.name, case.stage, found[video.id]] += 1
    assert not wrong


def test_planted_cases_end_where_they_belong(cooking: Demo) -> None:
    check_verdicts(cooking.root, "cooking")
    for table, stages in {
        "wiki_rejected": {"words"},
        "reddit_rejected": {"removed", "nsfw", "score", "toxicity"},
    }.items():
        found = {row["stage"] for row in rows(cooking.root, f"SELECT stage FROM clean.{table}")}
        assert stages <= found, table


def test_pairs_match_their_keywords(cooking: Demo) -> None:
    check_pairs(cooking.root, "cooking")


def test_a_science(tmp_path: Path) -> None:
    path = str(written("astronomy", tmp_path))
    root = played(tmp_path, path, (*LITTLE, *REST, *LAST)).root
    check_verdicts(root, path)
    check_pairs(root, path)
    length = rows(root, "SELECT max(clip_end_s - clip_start_s) AS s FROM release.pairs")[0]["s"]
    assert length <= 6.001  # as its profile says
    for where, text in texts(root / "release"):
        assert not MINECRAFT.findall(text), where
        assert not GAMES.findall(text), where


def test_a_source_that_the_profile_leaves_out_is_skipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "talk.toml"
    path.write_text('name = "talk"\ntitle = "Small Talk"\n[reddit]\nsubreddit = "smalltalk"\n')
    root = played(tmp_path, str(path), ("reddit reconstruct", "report")).root
    said = capsys.readouterr().out
    assert said.count("left out: the profile has no [youtube]") == 5  # three steps, pairs, tasks
    assert said.count("left out: the profile has no [wiki]") == 3
    assert {path.name for path in (root / "release").iterdir()} == {"README.md", "reddit"}
    assert rows(root, "SELECT * FROM release.reddit_posts")
    for where, text in texts(root / "release"):
        assert not MINECRAFT.findall(text), where


def test_keywords_are_proposed_from_the_crawled_wiki(
    cooking: Demo, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Titles, redirects and categories of what the demo crawled, and a list that passes."""
    path = tmp_path / "profile.toml"
    path.write_text(
        'name = "cooking"\ntitle = "Cooking"\n[pairs]\nkeyword_files = ["more.tsv"]\n'
        '[reddit]\nsubreddit = "Cooking"\n[release]\ncontact = "https://cooking.wiki/about"\n'
    )
    mine = tmp_path / "more.tsv"
    mine.write_text("keyword\tkind\trule\tforms\nFolding\ttechnique\n")
    titles = [row["title"] for row in rows(cooking.root, "SELECT title FROM clean.wiki_pages")]
    words = ["profile", "keywords", "--data", str(cooking.root), "--profile", str(path)]
    assert called(*words) == 0
    said = capsys.readouterr()
    proposed = [line.split("\t") for line in said.out.splitlines() if line[0] != "#"][1:]
    names = {row[0] for row in proposed}
    assert len(names & set(titles)) >= 8
    assert "Main Page" not in names
    listed = keywords.load(load_profile("cooking")).every
    assert {row[1] for row in proposed} <= {one.kind for one in listed}
    assert any(len(row) == 4 for row in proposed)  # a redirect is another form
    assert "rows proposed" in said.err
    out = tmp_path / "proposed.tsv"
    assert called(*words, "--out", str(out)) == 0
    assert called(*words, "--out", str(out)) == 2
    capsys.readouterr()
    # What is proposed is a list; once it is the profile's own, nothing more is.
    mine.write_text(out.read_text())
    assert called("profile", "check", str(path)) == 0
    assert "0 errors" in capsys.readouterr().out
    assert called(*words, "--json") == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["keywords"] == 0
    assert summary["not_proposed_by"]["already in the list"] == len(proposed)


def called(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    return int(ended.value.code or 0)
