"""The planted cases follow the thresholds of a profile."""

from pathlib import Path

from kb.core.config.profile import load_profile
from kb.sandbox.domain import domain_of
from tests.sandbox.domains import PROFILES, written


def test_labels_decide_only_where_the_profile_has_one(tmp_path: Path) -> None:
    evidence = {}
    for name in PROFILES:
        domain = domain_of(load_profile(written(name, tmp_path)))
        evidence[name] = {case.evidence for case in domain.cases if not case.stage}
        other = next(case for case in domain.cases if case.name == "another game")
        assert (other.stage == "topic") == (name == "valley")
    assert evidence["valley"] == {"game_label", "keywords"}
    assert evidence["bread"] == evidence["astronomy"] == {"keywords"}


def test_thresholds_that_nothing_fails_leave_their_cases_out(tmp_path: Path) -> None:
    path = written("bread", tmp_path)
    text = path.read_text().replace("[26, 10]", "[26]\nmin_views = 0\nmin_aspect_ratio = 0.1")
    path.write_text(text + "\n")
    domain = domain_of(load_profile(path))
    cases = {case.name: case.stage for case in domain.cases}
    assert "99 views" not in cases
    assert cases["vertical"] is None
    assert cases["Short"] == "duration"
