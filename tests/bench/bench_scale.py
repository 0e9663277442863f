"""Raw to release at a share of the paper's size, as a table with floors and what it makes at 100 %.

SHARE=0.05 make bench ARGS="-k scale"                            a share of your own
SHARE=0.05 AGAINST=before.json make bench ARGS="-k scale"        beside figures kept before
SHARE=0.05 KEEP=before.json CODE=../older make bench ARGS="…"    an older checkout's code
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.bench import scale

pytestmark = [pytest.mark.bench, pytest.mark.timeout(6 * 3600)]

SHARE = float(os.environ.get("SHARE", "0.003"))
MEMORY = 3 << 10  # MiB


def test_raw_to_release(tmp_path: Path) -> None:
    kept = os.environ.get("AGAINST")
    code = Path(os.environ.get("CODE", scale.HERE)).resolve()
    made = scale.figures(tmp_path, code, SHARE, os.cpu_count() or 1, [])
    print("\n" + scale.table(made, json.loads(Path(kept).read_text()) if kept else None))
    if "KEEP" in os.environ:
        Path(os.environ["KEEP"]).write_text(json.dumps(made, indent=1) + "\n")
    assert max(found["peak"] for found in made["stages"].values()) < MEMORY
