"""Publishes the pairs of a release to the simulated Zenodo of tests/services."""

from pathlib import Path
from typing import Any

from kb.core.summary import Summary
from kb.release.publish.publish import publish
from tests.faults import Sandbox
from tests.release.conftest import a_run
from tests.services.zenodo import TOKEN, Deposits


def store(service: Sandbox) -> Deposits:
    return service.applications["zenodo"]


def send(
    root: Path,
    service: Sandbox | str,
    only: str = "pairs",
    token: str = TOKEN,
    to: str = "zenodo-sandbox",
    **options: Any,
) -> Summary:
    endpoint = service if isinstance(service, str) else service.servers["zenodo"].url
    run = a_run(root, kb_zenodo_endpoint=endpoint, zenodo_token=token)
    return publish(run, to, only=[only] if only else None, **options)
