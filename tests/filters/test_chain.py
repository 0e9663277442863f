"""A user's own pipeline: its chains, stages and scorer."""

from pathlib import Path

import pytest

from kb.core.errors import SchemaMismatch, SettingError
from kb.filters.filter_run import run_clean
from tests.filters.made import TUESDAY, listing, put, rows, run_at, video

MINE = '''
from dataclasses import replace
from pathlib import Path
from kb.core.config.pipeline import Recipe
from kb.filters.predicates import AtLeast, AtMost

shipped = Recipe("youtube")


class Scorer:
    """Scores a text by its length; writes down what it was asked."""

    def model_key(self, run, source):
        return "lengths"

    def annotate(self, run, source, texts):
        asked = {text for part in texts for text in part.to_pylist() if text}
        Path(run.root, "asked.txt").write_text("\\n".join(sorted(asked)))

    def scores(self, key, root, source, texts):
        import pyarrow as pa
        lengths = [len(text) if text else None for text in texts.to_pylist()]
        return pa.table({name: pa.array([n and n / scale for n in lengths], pa.float32())
                         for name, scale in (("toxicity", 100), ("insult", 50))})


def clean(p):
    spec = shipped.defined("clean")(p)
    chain = spec.chains[0]
    title = AtMost("toxicity_title", 0.31, stage="toxicity", null_passes=True)
    stages = (*chain.stages[:-3], title, *chain.stages[-3:])
    return replace(spec, scorer=Scorer(), chains=(replace(chain, stages=stages),))
'''


@pytest.fixture(autouse=True)
def _own_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What may run is noted outside of the user's home."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "notes"))


def test_a_pipeline_of_one_s_own_with_scores(root: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(MINE)
    put(
        root,
        "videos",
        (TUESDAY, {}, listing(video("kept", snippet__title="Minecraft, a long title of a video"))),
    )
    # the shipped scores have four more categories than the stand-in's two
    for workers in (1, 2):
        summary = run_clean(run_at(root, workers=workers, pipeline=mine), "youtube")
        assert rows(root, "rejected")["kept"] | {"key": ""} == {
            "key": "",
            "stage": "toxicity",
            "reason": "above",
            "value": "0.68",
            "threshold": "0.31",
            "number": pytest.approx(0.68),
            "other_stages": "kept",
            "title": "Minecraft, a long title of a video",
            "channel_id": "UC1",
            "channel_title": None,
            "type": None,
            "text": "d",
            "post_id": None,
            "parent_id": None,
            "matched": None,
            "unmatched": None,
        }
        row = rows(root, "videos")["bare"]
        assert (
            round(row["toxicity_title"], 2),
            round(row["toxicity_title_toxicity"], 2),
            row["toxicity_title_threat"],
        ) == (0.28, 0.14, None)
        assert "toxicity" not in summary
    # only what reaches the stage is scored: not what an earlier stage drops
    asked = (root / "asked.txt").read_text().split("\n")
    assert "Minecraft bare" in asked
    assert "Minecraft few" not in asked
    assert "d" in asked


def test_a_pipeline_that_is_not_there_or_wrong(root: Path, tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="can't be read"):
        run_clean(run_at(root, pipeline=tmp_path / "nothing.py"), "youtube")
    wrong = tmp_path / "wrong.py"
    wrong.write_text(MINE.replace('AtMost("toxicity_title"', 'AtMost("toxicity_titel"'))
    with pytest.raises(SchemaMismatch, match="toxicity_titel"):
        run_clean(run_at(root, pipeline=wrong), "youtube")
    assert not (root / "clean" / "youtube").exists()
    assert not list((root / "clean").iterdir())
