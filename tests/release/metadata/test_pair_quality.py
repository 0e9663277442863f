"""What card and datasheet of the pairs say of their quality."""

import json
from pathlib import Path

import duckdb
import pytest

from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.made import build

SECTION = {
    "videos_with_both_tracks": 6120,
    "videos_compared": 198,
    "keywords": {
        "in_automatic": 7000,
        "in_manual": 7500,
        "manual_given_automatic": {"n": 7000, "share": 0.95, "low": 0.9446, "high": 0.9549},
        "automatic_given_manual": {"n": 7500, "share": 0.8867, "low": 0.8793, "high": 0.8937},
    },
    "automatic_later_s": {"n": 6650, "p25": -0.21, "p50": 0.1, "p75": 0.43},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = build(tmp_path_factory.mktemp("quality"), sources=("pairs",))
    (root / "pairs").mkdir(exist_ok=True)
    (root / "pairs" / "measures.json").write_text(json.dumps({"speech_recognition": SECTION}))
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
        assert "in 198 of 6,120 videos that have both tracks" in text
        assert "has 95.0% (95 % interval 94.5% to 95.5%, n = 7,000) of the keywords" in text
        assert "88.7% (95 % interval 87.9% to 89.4%, n = 7,500) of those" in text
        assert "between -0.21 and 0.43 s later" in text
        assert "they do not say whether the clip shows what the text names" in text
