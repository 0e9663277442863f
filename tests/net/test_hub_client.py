"""A hub that decides how much we read, through the client of huggingface_hub."""

import httpx2
import huggingface_hub
import pytest
from huggingface_hub.utils import get_session

from kb.net import hub_client, limits
from tests.conftest import needs
from tests.net.test_bounded import Hostile, hostile  # noqa: F401  the fixture

needs("huggingface_hub")


@pytest.fixture(autouse=True)
def _another_client_afterwards():
    yield
    huggingface_hub.set_client_factory(lambda: httpx2.Client())


@pytest.mark.parametrize("name", ["bomb", "endless", "drips"])
def test_an_answer_of_the_hub_without_end_is_one_error(
    hostile: Hostile,  # noqa: F811
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limits, "ANSWER_BYTES", 1_000_000)
    monkeypatch.setattr(limits, "ANSWER_S", -9.5)  # half a second
    hub_client.use_own_client(hostile.url)
    with pytest.raises((httpx2.TransportError, httpx2.DecodingError)):
        get_session().get(f"{hostile.url}/{name}")


def test_a_hub_on_this_machine_is_not_asked_through_a_proxy(
    hostile: Hostile,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("http_proxy", "all_proxy"):
        monkeypatch.setenv(name, "http://user:secret@127.0.0.1:9")
    hub_client.use_own_client(hostile.url)
    assert get_session().get(f"{hostile.url}/fine").text == "fine"
