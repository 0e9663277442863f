"""Tests of `kb.release.publish.zenodo`."""

from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path
from typing import Any

import pytest

from kb.core import clock
from kb.core.errors import (
    CredentialRefused,
    FatalError,
    Interrupted,
    KbError,
    MissingCredential,
    QuotaSpent,
    Unreachable,
    UsageError,
)
from tests.faults import Sandbox
from tests.inprocess import Here
from tests.release.publish.sending import send
from tests.release.signed import signed
from tests.services.zenodo import TOKEN


def test_an_upload_ends_in_the_midst_of_a_file(tmp_path: Path, service: Sandbox) -> None:
    from kb.core.config.settings import load_settings
    from kb.core.signals import stop
    from kb.net.session import HttpSession
    from kb.release.publish.zenodo import Zenodo, md5

    file = tmp_path / "large.tar"
    with file.open("wb") as sparse:
        sparse.truncate(64 << 20)
    client = Zenodo(HttpSession(load_settings(dotenv=False)), service.servers["zenodo"].url, TOKEN)
    draft = client.create({"title": "x"})
    service.faults.add("/api/files/", when=lambda environ: stop.request("SIGTERM") is not None)
    try:
        with pytest.raises(Interrupted):
            client.upload(draft["links"]["bucket"], file, md5(file), lambda size: None)
    finally:
        stop.clear()
    service.faults.clear()
    assert client.files(draft["id"]) == {}
    (tmp_path / "empty").touch()
    client.upload(draft["links"]["bucket"], file, md5(file), lambda size: None)
    client.upload(
        draft["links"]["bucket"], tmp_path / "empty", md5(tmp_path / "empty"), lambda size: None
    )
    assert {name: one["filesize"] for name, one in client.files(draft["id"]).items()} == {
        "large.tar": 64 << 20,
        "empty": 0,
    }


# What the service answers, what that means, and how many requests it took.
REFUSALS: dict[str, tuple[dict[str, Any], type[KbError], str]] = {
    "down": ({"status": 503, "times": None}, Unreachable, "the deposit service"),
    "a field": (
        {
            "method": "PUT",
            "status": 400,
            "body": {
                "message": "Validation error.",
                "errors": [{"field": "metadata.creators", "message": "Invalid ORCID."}],
            },
        },
        FatalError,
        r"refused \(400\): Validation error\.; metadata\.creators: Invalid ORCID\.",
    ),
    "another licence": (
        {"method": "PUT", "status": 200, "body": {"metadata": {"license": "cc-zero"}}},
        FatalError,
        "took the licence 'cc-zero' instead of 'cc-by-4.0'",
    ),
    "a long limit": (
        {"status": 429, "headers": {"Retry-After": "10800"}},
        QuotaSpent,
        "limit is spent until",
    ),
    "a limit of centuries": (
        {"status": 429, "headers": {"X-RateLimit-Reset": str(2**33)}},
        QuotaSpent,
        "limit is spent until",
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_a_refusal_is_named_and_nothing_is_published(
    root: Path, service: Sandbox, name: str
) -> None:
    fault, error, match = REFUSALS[name]
    service.faults.add("/api/deposit/depositions", **fault)
    with pytest.raises(error, match=match):
        send(root, service, publish=True)
    assert service.ledger.requests("/actions/publish") == []


def test_bad_tokens_and_addresses_end_before_anything_is_stored(
    root: Path, service: Sandbox
) -> None:
    url = service.servers["zenodo"].url
    with pytest.raises(MissingCredential):
        send(root, service, token="")
    with pytest.raises(UsageError, match="must begin with https"):
        send(root, "http://zenodo.example.org")
    assert service.ledger.requests() == []
    with pytest.raises(CredentialRefused) as caught:
        send(root, service, token="wrong-token-123")
    assert "wrong-token-123" not in str(caught.value)
    assert len(service.ledger.requests()) == 1
    with pytest.raises(FatalError, match=f"pairs: there is no deposit API at {url}/elsewhere"):
        send(root, f"{url}/elsewhere")
    assert send(root, f"{url}/api")["drafts"] == 1


@pytest.mark.parametrize(
    "wait", [None, lambda: "0", lambda: format_datetime(datetime.now(UTC) + timedelta(seconds=2))]
)
def test_a_short_limit_is_waited_for(
    root: Path, service: Sandbox, wait: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []
    monkeypatch.setattr(clock, "sleep", waited.append)
    headers = {"Retry-After": wait()} if wait else {}
    service.faults.add("/api/deposit", status=429, times=2, headers=headers)
    assert send(root, service)["drafts"] == 1
    assert len(waited) == 2
    assert sum(waited) < 20


DEEP = "[" * 100_000 + "]" * 100_000


_DEEPISH = '{"license": ' * 400 + "1" + "}" * 400


ODD: dict[str, dict[str, Any]] = {
    "deep": {"body": DEEP},
    "deep refusal": {"status": 400, "body": DEEP},
    "deep licence": {"method": "PUT", "body": f'{{"metadata": {_DEEPISH}}}'},
    "no object": {"body": '"text"'},
    "other types": {"body": {"id": "7", "links": [], "submitted": "no"}},
    "no address": {"method": "POST", "body": {"id": 7, "links": {"bucket": "http://["}}},
    "a name and a word": {
        "method": "POST",
        "body": {"id": 7, "links": {"bucket": "http://127.0.0.1@other.example/"}},
    },
    "not the text": {"body": b"\xff\xfe\x00"},
    "a redirect": {"status": 302, "headers": {"Location": "http://other.example/"}},
    "odd fields": {"status": 400, "body": {"message": "a\nb\x1b[31m", "errors": [{"field": 5}]}},
    "our token": {"status": 400, "body": {"message": f"bad {TOKEN}"}},
}


def test_token_goes_to_no_other_host(root: Path, service: Sandbox) -> None:
    with Sandbox(services=["zenodo"]) as other:
        made = {
            "id": 7,
            "submitted": False,
            "metadata": {},
            "links": {"bucket": f"{other.servers['zenodo'].url}/api/files/b"},
        }
        service.faults.add("/api/deposit/depositions", method="POST", status=201, body=made)
        service.faults.add("/api/deposit/depositions/7/files", status=200, body="[]")
        with pytest.raises(FatalError, match="another host"):
            send(root, service)
        service.faults.clear()
        service.faults.add(
            "/api/deposit",
            status=302,
            times=None,
            headers={"Location": f"{other.servers['zenodo'].url}/api/deposit/depositions"},
        )
        with pytest.raises(FatalError):
            send(root, service, only="reddit")
        assert other.ledger.requests() == []


@pytest.mark.parametrize("name", ODD)
def test_an_odd_answer_is_one_line_and_the_token_goes_nowhere(
    root: Path, service: Sandbox, name: str, here: Here
) -> None:
    headers = {"Content-Type": "application/json"}
    odd = {"status": 200, "times": None, "headers": headers, **ODD[name]}
    service.faults.add("/api/deposit", **odd)
    service.faults.add("/api/deposit/depositions/7/files", status=200, body="[]")
    env = service.settings() | {"KB_PROFILE": str(signed()), "KB_DATA": str(root)}
    words = ("release", "publish", "--to", "zenodo-sandbox", "--only", "pairs", "--publish")
    done = here(*words, env=env)
    assert done.code in (1, 4), done.err
    lines = [line for line in done.err.splitlines() if not line.startswith("pairs")]
    assert [line for line in lines if line.startswith("kb: ")] == lines[-1:], done.err
    assert "unexpected" not in done.err
    assert "Traceback" not in done.err
    assert "\x1b" not in done.err
    assert TOKEN not in done.err + done.out
    assert "kb: pairs: " in done.err
    noted = root / "state" / "deposits.json"
    assert not noted.exists() or TOKEN not in noted.read_text()
    asked = {seen.path.partition("?")[0] for seen in service.ledger.requests()}
    assert all(path.startswith("/api/") for path in asked)


def test_a_token_that_comes_back_is_noted_nowhere(root: Path, service: Sandbox) -> None:
    number = send(root, service)["sources"]["pairs"]["id"]
    said = {
        "id": number,
        "submitted": True,
        "doi": {"a": 1},
        "links": {"html": f"http://127.0.0.1/?x={TOKEN}"},
    }
    service.faults.add("/actions/publish", status=202, body=said)
    told = send(root, service, publish=True)["sources"]["pairs"]
    assert told["doi"] is None
    assert TOKEN not in f"{told} {(root / 'state' / 'deposits.json').read_text()}"
