"""Fixtures of this folder."""

from collections.abc import Iterator

import pytest

from kb.sandbox.server import Sandbox


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Iterator[Sandbox]:
    monkeypatch.setattr("kb.net.retry.FIRST_S", 0.001)  # retries without the wait between them
    with Sandbox(services=["zenodo"]) as sandbox:
        yield sandbox
