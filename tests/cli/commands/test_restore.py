"""Tests of `kb restore` at the command line."""

import shutil
from pathlib import Path

from tests.restore.conftest import (
    Made,
    made,  # noqa: F401  a fixture
)
from tests.youtube.job import Job


def test_the_profile_is_the_releases_own(made: Made, tmp_path: Path) -> None:  # noqa: F811
    release = shutil.copytree(made.release, tmp_path / "downloaded")
    job = Job(made.sandbox, tmp_path / "far")
    own = release / "pairs" / "profile.toml"
    own.write_text('name = "other"\ntitle = "Other"\n[youtube]\nunits_per_day = "many"\n')
    line = job.stopped("restore", str(release), "--plan", code=2)
    assert str(own) in line
    assert "units_per_day" in line
    profile = str(tmp_path / "far" / "profile" / "profile.toml")
    plan = job.done("restore", str(release), "--plan", "--profile", profile)
    assert plan["command"] == "restore --plan"
