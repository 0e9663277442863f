"""pairs/measures.json: sections stay while the rules do, and belong to the artifact."""

from dataclasses import replace

import pytest

from kb.artifacts import manifest
from kb.core.config.pipeline import load, locate
from kb.core.config.profile.pairs import Pairs
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.progress import Silent
from kb.pairs.measures.measures_file import FILE, read_measures, write_measure
from kb.verify.root import verify

pipeline = load(str(locate("pairs")))


def test_sections_do_not_replace_each_other(run: Run) -> None:
    with pytest.raises(FatalError, match="there are no pairs"):
        write_measure(run.root, "one", {"n": 1})
    pipeline.pairs(run, "parquet")
    write_measure(run.root, "two", {"n": 2})
    write_measure(run.root, "one", {"n": 1})
    write_measure(run.root, "two", {"n": 3})
    assert read_measures(run.root / "pairs") == {"one": {"n": 1}, "two": {"n": 3}}
    made = manifest.read(run.root, "pairs")
    assert made is not None
    assert made.files[FILE] == manifest.entry_of(run.root / "pairs" / FILE)
    places = [one.path for one in verify(run.root, Silent()).entries]
    assert run.root / "pairs" / FILE not in places


def test_they_stay_while_the_rules_of_the_pairs_do(run: Run) -> None:
    pipeline.pairs(run, "parquet")
    write_measure(run.root, "one", {"n": 1})
    pipeline.pairs(replace(run, again=True), "parquet")
    assert read_measures(run.root / "pairs") == {"one": {"n": 1}}
    section = run.profile.section(Pairs).model_copy(update={"min_gap_s": 1.5})
    other = run.profile.model_copy(update={"pairs": section})
    pipeline.pairs(replace(run, profile=other), "parquet")
    assert read_measures(run.root / "pairs") == {}
