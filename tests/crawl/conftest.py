"""Fixtures of this folder."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from tests.crawl.service import Service, serving


@pytest.fixture
def service() -> Iterator[Service]:
    """Ten notes on four pages."""
    with serving(10) as running:
        yield running


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A fresh data root."""
    settings = load_settings(dotenv=False, kb_data=tmp_path)
    return Run(settings=settings, profile=load_profile("minecraft"), root=tmp_path)
