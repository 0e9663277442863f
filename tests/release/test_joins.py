"""The queries of each card's section Joins, on a downloaded release of the demo."""

import re
import shutil
from pathlib import Path

import pytest

import kb

JOINED = ("youtube", "wiki", "reddit", "pairs", "tasks", "links")


@pytest.fixture(scope="module")
def downloaded_demo(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shutil.copytree(
        demo / "data" / "demo" / "release", tmp_path_factory.mktemp("far") / "release"
    )


@pytest.mark.parametrize("source", JOINED)
def test_the_queries_that_join_tables_have_rows(downloaded_demo: Path, source: str) -> None:
    card = (downloaded_demo / source / "README.md").read_text(encoding="utf-8")
    block = re.search(r"## Joins\n.*?```sql\n(.*?)```", card, re.DOTALL)
    assert block
    queries = block[1].strip().removesuffix(";").split(";\n")
    assert len(queries) >= 2
    data = kb.load(downloaded_demo)
    for query in queries:
        assert len(data.sql(query)), query


@pytest.mark.parametrize("source", JOINED)
def test_the_globs_of_the_card_name_one_table_each(downloaded_demo: Path, source: str) -> None:
    import duckdb
    import pandas
    import polars

    folder = downloaded_demo / source
    card = (folder / "README.md").read_text(encoding="utf-8")
    globs = re.findall(r"`(\w+-\*\.parquet)`", card)
    shards = set(folder.glob("*.parquet"))
    assert shards == {path for one in globs for path in folder.glob(one)}
    for one in globs:
        rows = duckdb.read_parquet(str(folder / one)).count("*").fetchall()[0][0]
        assert polars.read_parquet(str(folder / one)).height == rows
        assert sum(len(pandas.read_parquet(path)) for path in folder.glob(one)) == rows


def test_an_id_has_one_type_in_all_released_tables() -> None:
    from kb.schema import tables

    kinds: dict[str, set[str]] = {}
    for declared in tables().values():
        for column in declared.columns if declared.released else ():
            if column.released and column.name.endswith("_id"):
                name = "page_id" if column.name == "wiki_page_id" else column.name
                kinds.setdefault(name, set()).add(column.type)
            if column.released and column.type.startswith("timestamp"):
                assert column.type == "timestamp[us, UTC]"
    kinds.pop("parent_id")  # a full name at Reddit, an element in the wiki
    assert not {name: types for name, types in kinds.items() if len(types) > 1}


def test_descriptions_say_more_than_the_name_and_nothing_of_how_rows_were_collected() -> None:
    from kb.schema import tables

    for declared in tables().values():
        for column in declared.columns if declared.released else ():
            if not column.released:
                continue
            words = column.name.replace("_", " ")
            assert not re.match(rf"(the )?{words}s?\b", column.doc, re.IGNORECASE), column.doc
            told = f"{column.doc} {column.why_null}"
            assert not re.search(r"\b(stages?|crawl\w*|frontier|ledger)\b", told), told


@pytest.mark.parametrize("source", JOINED)
def test_a_card_has_no_words_of_a_crawler(downloaded_demo: Path, source: str) -> None:
    card = (downloaded_demo / source / "README.md").read_text(encoding="utf-8")
    text = card[card.index("\n# ") :].replace("lorecrawl", "").replace("Lorecrawl", "")
    settings = text.index("| setting | value |")
    told = text[:settings] + text[text.index("## Changes") :]
    assert not re.search(r"\b(crawl\w*|frontier|ledger|raw answers?|kb refresh)\b", told)
