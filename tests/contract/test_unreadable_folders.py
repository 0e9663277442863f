"""Folders that may not be read, such as the `lost+found` of a disk, decide nothing: neither beside
a data root nor in it.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import clean_environment
from tests.filters import full_root

# So that root, as which tests may run, obeys the permissions of files as well.
UNPRIVILEGED = (
    ("setpriv", "--bounding-set", "-dac_override,-dac_read_search") if os.geteuid() == 0 else ()
)
COMMANDS = (
    "status --data data",
    "query --tables --data data",
    "verify --data data",
    "build youtube --plan --data data",
    "purge youtube --plan --data data",
    "youtube export --data data",
    "search creeper --data data",
    "query --tables --data dta",
    "query --tables --data .",
)
SEVERAL = """
import contextlib, io, json, sys
from kb.cli.app import app
from kb.cli.framework.exit_codes import run_to_exit_code
said = []
for words in sys.argv[1:]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_to_exit_code(app, words.split())
    said.append((words, code, *(one for one in err.getvalue().splitlines() if "kb: " in one)))
print(json.dumps(said))
"""


def test_folders_that_can_not_be_read_decide_nothing(tmp_path: Path) -> None:
    if UNPRIVILEGED and shutil.which(UNPRIVILEGED[0]) is None:
        pytest.skip("root may read everything here")
    full_root.make(tmp_path / "data")
    root = tmp_path / "data"
    before = run(tmp_path)
    assert [code for _, code, *_ in before] == [0] * 7 + [2, 2]
    assert all("did you mean --data data?" in line for _, _, line in before[-2:])
    unreadable = [
        folder / "lost+found"
        for folder in (tmp_path, root, *root.iterdir(), *root.glob("*/youtube"))
        if folder.is_dir() and folder != root / "release" / "youtube"  # which is flat
    ]
    for folder in unreadable:
        folder.mkdir(mode=0)
    try:
        assert run(tmp_path) == before
    finally:
        for folder in unreadable:
            folder.chmod(0o700)


def run(place: Path) -> list[list[object]]:
    """Of each command its words, exit code and the line that says why it ended."""
    done = subprocess.run(
        [*UNPRIVILEGED, sys.executable, "-c", SEVERAL, *COMMANDS],
        cwd=place,
        env={**clean_environment(), "XDG_CACHE_HOME": str(place / ".cache")},
        capture_output=True,
        text=True,
        check=True,
    )
    lines: list[list[object]] = json.loads(done.stdout)
    return lines
