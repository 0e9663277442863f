"""What card and datasheet of the pairs say of their quality."""

from pathlib import Path

import duckdb
import pytest

from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.made import build


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = build(tmp_path_factory.mktemp("quality"), sources=("pairs",))
    release(a_run(root))
    return root / "release" / "pairs"


def test_card_and_datasheet_give_the_figures_of_the_tables(folder: Path) -> None:
    total, words, verbs, english, recurring = duckdb.sql(f"""
        SELECT count(*), count(*) FILTER (timing = 'word'), count(*) FILTER (has_verb),
            count(*) FILTER (language = 'en'), count(*) FILTER (recurring_share > 0.5)
        FROM '{folder}/pairs-*.parquet' JOIN '{folder}/quality-*.parquet' USING (pair_id)
        """).fetchall()[0]
    assert 0 < words < total
    assert 0 < verbs < total
    for name in ("README.md", "DATASHEET.md"):
        text = " ".join((folder / name).read_text(encoding="utf-8").split())
        assert "How good are these pairs" in text
        for what, count in (
            ("Times", words),
            ("Near-duplicates", 0),
            ("Recurring text: in", recurring),
            ("Languages", english),
            ("Verbs", verbs),
        ):
            said = f"{what.partition(':')[0]}:{what.partition(':')[2]} {count} of {total} pairs"
            assert said in text, said
        assert "they do not say whether the clip shows what the text names" in text
