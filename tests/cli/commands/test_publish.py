"""`kb release`, `kb release publish` and `kb restore` at the command line."""

import hashlib
import re
import shutil
from pathlib import Path

from tests.faults import Sandbox
from tests.inprocess import Here
from tests.release.conftest import (
    SECRETS,
    released,  # noqa: F401  a fixture
)
from tests.release.gate.refusals import rewritten
from tests.release.gate.test_check import Rows
from tests.release.made import build
from tests.release.publish.test_publish import store
from tests.release.signed import signed
from tests.restore.conftest import (
    Made,
    made,  # noqa: F401  a fixture
)
from tests.youtube.job import Job


def test_publish_says_where_each_draft_is(
    released: Path,  # noqa: F811
    here: Here,
    tmp_path: Path,
) -> None:
    root = shutil.copytree(released, tmp_path / "data")
    words = ["--to", "zenodo-sandbox", "--data", str(root), "--profile", str(signed()), "--quiet"]
    with Sandbox(services=["zenodo"]) as service:
        env = {**service.settings(), "KB_NOW": "2026-11-10T00:00:00Z"}
        done = here("release", "publish", *words, "--only", "pairs", env=env)
        number, url = next(iter(store(service).by_id)), service.servers["zenodo"].url
    assert done.code == 0, done.err
    reserved = f"10.5072/zenodo.{number}"
    assert done.out.splitlines()[0] == f"pairs  draft  {number}  {reserved}  {url}/deposit/{number}"


def test_everything_is_said_at_once(tmp_path: Path, here: Here) -> None:
    def edit(name: str, rows: Rows) -> None:
        if name == "youtube/videos":
            rows[0]["title"] = f"{SECRETS['youtube_api_key']} and jane@mail.example"
            rows[1]["toxicity_title"] = None

    build(tmp_path, edit)
    rewritten(
        tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(2)
    )
    env = {"YOUTUBE_API_KEY": SECRETS["youtube_api_key"], "KB_NOW": "2026-11-10T00:00:00Z"}
    done = here("release", "--data", str(tmp_path), "--quiet", env=env)
    assert done.code == 1
    said = done.err.splitlines()
    assert sorted({line.partition(":")[0] for line in said}) == [
        "kb",
        "personal data",
        "rows",
        "secret",
        "toxicity",
    ]
    assert said[-1].startswith("kb: the release is refused for 4 reasons")
    assert not any(SECRETS["youtube_api_key"] in line for line in said)
    assert not (tmp_path / "release" / "youtube" / "README.md").exists()


def test_the_profile_is_the_releases_own(made: Made, tmp_path: Path) -> None:  # noqa: F811
    release = shutil.copytree(made.release, tmp_path / "downloaded")
    job = Job(made.sandbox, tmp_path / "far")
    own = release / "pairs" / "profile.toml"
    own.write_text('name = "other"\ntitle = "Other"\n[youtube]\nunits_per_day = "many"\n')
    line = job.stopped("restore", str(release), "--plan", code=2)
    assert str(own) in line
    assert "units_per_day" in line
    sums, sha256 = release / "pairs" / "SHA256SUMS", hashlib.sha256(own.read_bytes()).hexdigest()
    sums.write_text(re.sub(r"\w+(?=  profile\.toml)", sha256, sums.read_text()))
    profile = str(tmp_path / "far" / "profile" / "profile.toml")
    plan = job.done("restore", str(release), "--plan", "--profile", profile)
    assert plan["command"] == "restore --plan"
