"""A running sandbox, and the real clients pointed at it."""

from collections.abc import Iterator
from typing import Any

import pytest
import requests
from requests.adapters import HTTPAdapter

from kb.sandbox.world import World
from tests.faults import Sandbox


@pytest.fixture
def services() -> Iterator[Sandbox]:
    """YouTube alone, a fresh world each time."""
    with Sandbox(World(), services=["youtube"]) as sandbox:
        yield sandbox


@pytest.fixture
def data_api(services: Sandbox) -> Any:
    """The real google-api-python-client."""
    return make_client(services)


@pytest.fixture
def web(services: Sandbox) -> requests.Session:
    """A session for which https://www.youtube.com is the sandbox."""
    root = services.servers["youtube"].url

    class ToSandbox(HTTPAdapter):
        def send(self, request: Any, **options: Any) -> Any:
            request.url = request.url.replace("https://www.youtube.com", root)
            return super().send(request, **options)

    session = requests.Session()
    session.mount("https://www.youtube.com/", ToSandbox())
    return session


def make_client(services: Sandbox, key: str | None = None) -> Any:
    from googleapiclient.discovery import build

    settings = services.settings()
    return build(
        "youtube",
        "v3",
        developerKey=key or settings["YOUTUBE_API_KEY"],
        static_discovery=True,
        cache_discovery=False,
        client_options={"api_endpoint": settings["KB_YOUTUBE_ENDPOINT"]},
    )
