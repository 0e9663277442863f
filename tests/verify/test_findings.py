"""Tests of `kb.verify.findings`."""

from pathlib import Path

import pytest

from kb.verify.findings import Findings


@pytest.fixture
def findings(tmp_path: Path) -> Findings:
    made = Findings(lambda n: None)
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"12345")
    made.checked("clean", tmp_path / "a", "", "")
    made.checked("clean", tmp_path / "b", "checksum mismatch", "run it again")
    made.missing("pairs", tmp_path / "c", "run it again")
    made.foreign("other", tmp_path / "b", "no command has written it", "move it away")
    return made


def test_counts_are_by_kind_and_state(findings: Findings, tmp_path: Path) -> None:
    assert list(findings.table()) == [
        ("kind", "whole", "damaged", "missing", "foreign"),
        ("clean", "1 (5 B)", "1 (5 B)", "-", "-"),
        ("pairs", "-", "-", "1 (0 B)", "-"),
        ("other", "-", "-", "-", "1 (5 B)"),
        ("all", "1 (5 B)", "1 (5 B)", "1 (0 B)", "1 (5 B)"),
    ]
    summary = findings.summary(tmp_path)
    assert (summary["files_whole"], summary["files_damaged"], summary["bytes"]) == (1, 1, 15)
    assert summary["kinds"]["clean"]["damaged"] == {"files": 1, "bytes": 5}


def test_what_no_longer_applies_is_dropped(findings: Findings) -> None:
    findings.drop(findings.of_kinds("pairs"))
    assert findings.total("missing") == (0, 0)
    assert [one.kind for one in findings.entries] == ["clean", "other"]


def test_a_step_whose_file_is_replaced_meanwhile_begins_again(
    findings: Findings, tmp_path: Path
) -> None:
    tries = []

    def step() -> None:
        findings.intact("state", tmp_path / "a")
        tries.append(1)
        if len(tries) == 1:
            findings.missing("state", tmp_path / "c", "")
            raise FileNotFoundError

    findings.retrying(step)
    assert (len(tries), findings.of_kinds("state"), findings.total("whole", ["state"])) == (
        2,
        [],
        (1, 5),
    )
