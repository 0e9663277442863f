"""A data root with invented pairs, built once."""

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.pairs.build import build
from tests.pairs.made import PHRASES, fill, tables
from tests.recipes import export


@pytest.fixture(scope="session")
def judged(tmp_path_factory: pytest.TempPathFactory, make_rows) -> Run:
    root = tmp_path_factory.mktemp("labels") / "data"
    fill(root, *tables(60, 400, PHRASES, share=0.06), make_rows)
    run = Run(load_settings(dotenv=False), load_profile("minecraft"), root, workers=1)
    build(run)
    export(run, "pairs", "parquet")
    return run
