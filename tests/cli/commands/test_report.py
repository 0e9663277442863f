"""Tests of `kb report` at the command line."""

import json
from pathlib import Path

import pytest

from tests.release.made import build
from tests.report.conftest import no_pdf  # noqa: F401  a fixture


@pytest.mark.usefixtures("no_pdf")
def test_command_prints_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from kb.cli import main

    (tmp_path / "state").mkdir()
    build(tmp_path, sources=("pairs",), export=False, n=10)
    with pytest.raises(SystemExit) as left:
        main(["report", "--data", str(tmp_path), "--json", "--quiet"])
    assert not left.value.code
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["figures"] == 3
    assert Path(summary["page"]).is_file()
