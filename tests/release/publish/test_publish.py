"""Publishing to a loopback service that behaves as the documented API, errors included."""

import hashlib
import json
import os
import shutil
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path
from time import monotonic
from typing import Any

import duckdb
import pytest

from kb.core.errors import (
    CredentialRefused,
    DamagedData,
    FatalError,
    MissingCredential,
    QuotaSpent,
    ReleaseRefused,
    Unreachable,
    UsageError,
)
from kb.core.summary import Summary
from kb.release.build import release
from kb.release.publish.publish import publish
from kb.sandbox.server import Sandbox
from kb.sandbox.zenodo.service import TOKEN, Deposits
from tests import processes
from tests.conftest import ROOT
from tests.inprocess import Here
from tests.release.conftest import a_run
from tests.release.made import build
from tests.release.signed import LINES, signed


@pytest.fixture
def root(released: Path, tmp_path: Path) -> Path:
    """A release of its own, so that a test may change it."""
    return Path(shutil.copytree(released, tmp_path / "data"))


def store(service: Sandbox) -> Deposits:
    return service.servers["zenodo"].application.deposits


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


def puts(service: Sandbox) -> list[str]:
    return [
        seen.path.rpartition("/")[2]
        for seen in service.ledger.requests("/api/files/")
        if seen.method == "PUT"
    ]


def test_a_draft_for_each_folder_with_every_file(root: Path, service: Sandbox) -> None:
    summary = send(root, service, only="")
    assert (summary["deposits"], summary["drafts"], summary["published"]) == (5, 5, 0)
    for source, shown in summary["sources"].items():
        deposit = store(service).by_id[shown["id"]]
        folder = root / "release" / source
        assert not deposit.submitted
        assert {name: hashlib.md5(data).hexdigest() for name, data in deposit.files.items()} == {
            path.name: hashlib.md5(path.read_bytes()).hexdigest() for path in folder.iterdir()
        }
        assert deposit.metadata["license"] == {"wiki": "cc-by-nc-sa-3.0"}.get(source, "cc-by-4.0")
        assert deposit.metadata["title"].startswith("Minecraft")
    assert not any(
        path.read_bytes().count(TOKEN.encode()) for path in root.rglob("*") if path.is_file()
    )
    assert not any(TOKEN in f"{seen.path}?{seen.query}" for seen in service.ledger.requests())


def test_publish_is_a_step_of_its_own(root: Path, service: Sandbox) -> None:
    draft = send(root, service)
    sent = len(puts(service))
    done = send(root, service, publish=True)
    assert done["sources"]["pairs"]["id"] == draft["sources"]["pairs"]["id"]
    assert done["sources"]["pairs"]["doi"] == f"10.5072/zenodo.{draft['sources']['pairs']['id']}"
    assert len(puts(service)) == sent
    again = send(root, service, publish=True)
    assert (again["unchanged"], again["uploaded"], len(store(service).by_id)) == (1, 0, 1)


def test_an_upload_that_broke_off_goes_on(root: Path, service: Sandbox) -> None:
    fault = service.faults.add("/api/files/", after=4, times=None, reset=True)
    with pytest.raises(Unreachable):
        send(root, service)
    service.faults.remove(fault)
    before = puts(service)[:4]
    done = len(puts(service))
    summary = send(root, service)
    rest = puts(service)[done:]
    assert len(store(service).by_id) == 1
    assert not set(before) & set(rest)
    assert summary["uploaded"] == len(rest) == len(list((root / "release" / "pairs").iterdir())) - 4


def test_a_killed_upload_goes_on_with_the_same_draft(root: Path, service: Sandbox) -> None:
    held = service.faults.add("/api/files/.*croissant", hold=True)
    to = ("release", "publish", "--to", "zenodo-sandbox", "--only", "pairs")
    command = (*to, "--data", str(root), "--profile", str(signed()))
    environment = {**os.environ, **service.settings(), "KB_NOW": "2026-11-10T00:00:00Z"}
    process = processes.start(command, env=environment, cwd=ROOT)
    assert held.arrived.wait(60)
    process.kill()
    process.communicate()
    held.release()
    done = processes.run([*command, "--json"], env=environment, cwd=ROOT, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["drafts"] == 1
    assert len(store(service).by_id) == 1
    assert set(next(iter(store(service).by_id.values())).files) == {
        path.name for path in (root / "release" / "pairs").iterdir()
    }
    assert TOKEN not in done.stderr + done.stdout


def test_a_draft_whose_answer_was_lost_is_found_again(root: Path, service: Sandbox) -> None:
    service.faults.add("/api/deposit/depositions", method="POST", cut=0.5)
    with pytest.raises(Unreachable):
        send(root, service)
    assert len(store(service).by_id) == 1
    send(root, service)
    assert len(store(service).by_id) == 1


def test_a_publication_whose_answer_was_lost_is_not_repeated(root: Path, service: Sandbox) -> None:
    service.faults.add("/actions/publish", cut=0.3)
    assert send(root, service, publish=True)["published"] == 1
    assert len(service.ledger.requests("/actions/publish")) == 1


def test_damaged_upload_is_sent_again_and_not_for_ever(root: Path, service: Sandbox) -> None:
    service.faults.add(
        "/api/files/", method="PUT", status=201, body={"checksum": "md5:" + "0" * 32}
    )
    assert send(root, service)["drafts"] == 1
    assert len(puts(service)) == len(set(puts(service))) + 1
    (root / "release" / "pairs" / "SHA256SUMS").touch()
    service.faults.add(
        "/api/files/", method="PUT", times=None, status=201, body={"checksum": "md5:" + "0" * 32}
    )
    store(service).by_id.clear()
    with pytest.raises(FatalError, match="arrived damaged 5 times"):
        send(root, service)


@pytest.mark.parametrize("token", ["wrong-token-123"])
def test_refused_token_ends_after_one_request(root: Path, service: Sandbox, token: str) -> None:
    with pytest.raises(CredentialRefused) as caught:
        send(root, service, token=token)
    assert token not in str(caught.value)
    assert len(service.ledger.requests()) == 1


def test_no_token_is_exit_2_before_anything(root: Path, service: Sandbox) -> None:
    with pytest.raises(MissingCredential) as caught:
        send(root, service, token="")
    assert caught.value.exit_code == 2
    assert service.ledger.requests() == []


def test_short_limit_is_waited_out_and_a_long_one_is_exit_3(root: Path, service: Sandbox) -> None:
    service.faults.add(
        "/api/files/",
        status=429,
        times=2,
        headers={"Retry-After": "0"},
        body={"status": 429, "message": "Too many requests"},
    )
    assert send(root, service)["drafts"] == 1
    service.faults.add("/api/deposit", status=429, headers={"Retry-After": "3600"})
    with pytest.raises(QuotaSpent) as caught:
        send(root, service)
    assert caught.value.exit_code == 3
    assert caught.value.reset_at is not None


def test_service_down_is_exit_3(root: Path, service: Sandbox) -> None:
    service.faults.add("/api/deposit", status=503, times=None)
    with pytest.raises(Unreachable) as caught:
        send(root, service)
    assert caught.value.exit_code == 3


def test_refused_metadata_is_said_field_by_field(root: Path, service: Sandbox) -> None:
    service.faults.add(
        "/api/deposit/depositions/",
        method="PUT",
        status=400,
        body={
            "status": 400,
            "message": "Validation error.",
            "errors": [{"field": "metadata.creators", "message": "Invalid ORCID."}],
        },
    )
    with pytest.raises(
        FatalError,
        match=r"refused \(400\): Validation error\.; metadata\.creators: Invalid ORCID\.",
    ):
        send(root, service, publish=True)
    assert not any(deposit.submitted for deposit in store(service).by_id.values())


def test_another_licence_than_ours_is_never_published(root: Path, service: Sandbox) -> None:
    service.faults.add(
        "/api/deposit/depositions/",
        method="PUT",
        status=200,
        body={"metadata": {"license": "cc-zero"}},
    )
    with pytest.raises(FatalError, match=r"took the licence 'cc-zero' instead of 'cc-by-4.0'"):
        send(root, service, publish=True)
    assert service.ledger.requests("/actions/publish") == []


def test_deposit_metadata_without_licence_is_refused_by_the_gate(
    root: Path, service: Sandbox
) -> None:
    path = root / "release" / "pairs" / "zenodo.json"
    body = json.loads(path.read_text())
    del body["metadata"]["license"]
    path.write_text(json.dumps(body))
    with pytest.raises(ReleaseRefused) as caught:
        send(root, service)
    assert (
        "licence: pairs/zenodo.json: names no licence; Zenodo would take CC0"
        in caught.value.problems
    )
    assert service.ledger.requests() == []


def test_a_folder_that_changed_since_the_gate_is_refused(root: Path, service: Sandbox) -> None:
    (root / "release" / "pairs" / "README.md").write_text("mine")
    with pytest.raises(ReleaseRefused) as caught:
        send(root, service)
    assert caught.value.problems == [
        "checksum: pairs/README.md: differs from SHA256SUMS; export it again"
    ]


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


DEEP = "[" * 100_000 + "]" * 100_000


_DEEPISH = '{"license": ' * 400 + "1" + "}" * 400


ODD: dict[str, dict[str, Any]] = {
    "deep": {"body": DEEP},
    "deep refusal": {"status": 400, "body": DEEP},
    "deep licence": {"method": "PUT", "body": f'{{"metadata": {_DEEPISH}}}'},
    "no object": {"body": '"text"'},
    "a number": {"body": "1e400"},
    "other types": {"body": {"id": "7", "links": [], "submitted": "no"}},
    "no deposits": {"method": "POST", "body": {"id": 7, "links": {"bucket": ["x"]}}},
    "no address": {"method": "POST", "body": {"id": 7, "links": {"bucket": "http://["}}},
    "a name and a word": {
        "method": "POST",
        "body": {"id": 7, "links": {"bucket": "http://127.0.0.1@other.example/"}},
    },
    "not the text": {"body": b"\xff\xfe\x00"},
    "a redirect": {"status": 302, "headers": {"Location": "http://other.example/"}},
    "a permanent one": {"status": 308, "headers": {"Location": "//other.example/x"}},
    "odd fields": {"status": 400, "body": {"message": "a\nb\x1b[31m", "errors": [{"field": 5}]}},
    "our token": {"status": 400, "body": {"message": f"bad {TOKEN}"}},
}


SAID = {"a redirect": "redirects (302)"}


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
    assert done.code in (1, 3), done.err
    lines = [line for line in done.err.splitlines() if not line.startswith("pairs")]
    assert [line for line in lines if line.startswith("kb: ")] == lines[-1:], done.err
    assert "unexpected" not in done.err
    assert "Traceback" not in done.err
    assert "\x1b" not in done.err
    assert TOKEN not in done.err + done.out
    assert SAID.get(name, "kb: pairs: ") in done.err
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


def test_changed_release_becomes_a_new_version(root: Path, service: Sandbox) -> None:
    first = send(root, service, publish=True)["sources"]["pairs"]["id"]
    shutil.rmtree(root / "release" / "pairs")
    build(root, sources=("pairs",), n=70)
    profile = root / "mine.toml"
    profile.write_text(
        'name = "minecraft"\ntitle = "Minecraft"\n[release]\nversion ='
        f' "1.1.0"\n{LINES}[youtube]\nkeywords = ["x"]\ncategory_ids = [20]\n'
    )
    run = a_run(root, profile, kb_zenodo_endpoint=service.servers["zenodo"].url, zenodo_token=TOKEN)
    others = [root / "release" / name for name in ("youtube", "wiki", "reddit")]
    for folder in others:
        shutil.rmtree(folder)
    release(run, ["pairs"])
    summary = publish(run, "zenodo-sandbox", publish=True, only=["pairs"])
    second = store(service).by_id[summary["sources"]["pairs"]["id"]]
    assert second.id != first
    assert second.concept == store(service).by_id[first].concept
    assert second.metadata["version"] == "1.1.0"
    assert {name: hashlib.sha256(data).hexdigest() for name, data in second.files.items()} == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (root / "release" / "pairs").iterdir()
    }
    assert summary["uploaded"] < len(
        second.files
    )  # what did not change was taken over by the service


def test_an_open_draft_of_a_new_version_is_used(root: Path, service: Sandbox) -> None:
    import requests

    first = send(root, service, publish=True)["sources"]["pairs"]["id"]
    url = service.servers["zenodo"].url
    by_hand = requests.post(
        f"{url}/api/deposit/depositions/{first}/actions/newversion",
        headers={"Authorization": f"Bearer {TOKEN}"},
        timeout=10,
    ).json()
    shutil.rmtree(root / "release" / "pairs")
    build(root, sources=("pairs",), n=70)
    release(a_run(root))
    second = send(root, service)["sources"]["pairs"]["id"]
    assert by_hand["links"]["latest_draft"].endswith(f"/{second}")
    assert len(store(service).by_id) == 2


def test_release_of_the_tiny_model_goes_to_loopback_only(root: Path, service: Sandbox) -> None:
    folder = root / "annotations" / "youtube"
    folder.mkdir(parents=True)
    duckdb.connect().execute(
        "COPY (SELECT 'lorecrawl_tiny' AS model, 'abc' AS revision,"
        f" 'fp32' AS precision) TO '{folder / 'a.parquet'}' (FORMAT parquet)"
    )
    assert release(a_run(root))["sandbox_model"]
    assert "tiny toxicity model" in (root / "release" / "youtube" / "README.md").read_text()
    assert send(root, service, only="youtube")["drafts"] == 1
    with pytest.raises(ReleaseRefused) as caught:
        send(root, "https://sandbox.zenodo.org", only="youtube")
    assert caught.value.problems[0].startswith(
        "sandbox model: youtube: scored with the sandbox's tiny model"
    )
    shutil.rmtree(folder)  # the mark stays with the folder, whatever happens to the scores
    with pytest.raises(ReleaseRefused):
        send(root, "https://sandbox.zenodo.org", only="youtube")


def test_token_is_never_sent_in_the_clear(root: Path) -> None:
    with pytest.raises(UsageError, match="must begin with https"):
        send(root, "http://zenodo.example.org")


def test_too_many_files_for_a_record(root: Path, service: Sandbox) -> None:
    folder = root / "release" / "pairs"
    for number in range(100):
        (folder / f"extra-{number}.tar").write_bytes(b"x")
    with pytest.raises(ReleaseRefused) as caught:
        send(root, service)
    assert any(
        line.startswith("size: pairs: 113 files, a record takes 100")
        for line in caught.value.problems
    )


def test_second_publisher_is_told_of_the_first(root: Path, service: Sandbox) -> None:
    from kb.core.errors import WriterLocked
    from kb.store.lock import writer

    with writer(root, "deposits"), pytest.raises(WriterLocked, match=f"pid {os.getpid()}"):
        send(root, service)


def test_a_publication_that_was_never_noted_is_not_repeated(root: Path, service: Sandbox) -> None:
    draft = send(root, service)["sources"]["pairs"]["id"]
    state = (root / "state" / "deposits.json").read_text()
    send(root, service, publish=True)
    (root / "state" / "deposits.json").write_text(
        state
    )  # killed between the publication and its note
    sent = len(puts(service))
    for _ in range(2):
        again = send(root, service, publish=True)
        assert (again["unchanged"], again["sources"]["pairs"]["id"]) == (1, draft)
        assert again["sources"]["pairs"]["doi"] == f"10.5072/zenodo.{draft}"
    assert (len(store(service).by_id), len(puts(service))) == (1, sent)
    assert service.ledger.requests("/actions/newversion") == []


def test_a_draft_published_by_hand_with_other_files_gets_a_new_version(
    root: Path, service: Sandbox
) -> None:
    draft = send(root, service)["sources"]["pairs"]["id"]
    deposit = store(service).by_id[draft]
    deposit.files["README.md"], deposit.submitted, deposit.metadata["doi"] = (
        b"other",
        True,
        "10.5072/by-hand",
    )
    again = send(root, service, publish=True)
    assert (again["published"], again["uploaded"], len(store(service).by_id)) == (1, 1, 2)


def test_a_folder_that_fails_is_named_and_so_is_what_is_public(
    root: Path, service: Sandbox
) -> None:
    service.faults.add(
        "/api/deposit/depositions/",
        method="PUT",
        status=400,
        when=lambda environ: len(store(service).by_id) == 3,
        body={"status": 400, "message": "no"},
    )
    with pytest.raises(FatalError) as caught:
        send(root, service, only="", publish=True)
    first, second = list(store(service).by_id)[:2]
    assert str(caught.value) == (
        "reddit: the deposit service refused (400): no; published before that:"
        f" youtube (10.5072/zenodo.{first}), wiki (10.5072/zenodo.{second})"
    )
    summary = caught.value.summary or {}
    assert (summary["published"], list(summary["sources"])) == (2, ["youtube", "wiki"])


@pytest.mark.parametrize(
    "entry",
    [
        "null",
        "[1]",
        '{"127.0.0.1/pairs": 5}',
        '{"127.0.0.1/pairs": {"id": null}}',
        '{"127.0.0.1/pairs": {"published": "x"}}',
    ],
)
def test_a_damaged_state_is_a_line_and_nothing_is_sent(
    root: Path, service: Sandbox, entry: str
) -> None:
    (root / "state").mkdir(exist_ok=True)
    (root / "state" / "deposits.json").write_text(entry)
    with pytest.raises(DamagedData, match=r"deposits\.json is damaged"):
        send(root, service)
    assert service.ledger.requests() == []


def test_anothers_deposit_in_the_state_is_no_bad_token(root: Path, service: Sandbox) -> None:
    send(root, service)
    service.faults.add(
        "/api/deposit/depositions/",
        status=403,
        body={"status": 403, "message": "Permission denied."},
    )
    with pytest.raises(
        FatalError, match=r"pairs: the deposit service refused \(403\): Permission denied\."
    ) as caught:
        send(root, service)
    assert "another account's" in caught.value.hint
    service.faults.add(
        "/api/deposit/depositions/", status=401, body={"status": 401, "message": "no"}
    )
    with pytest.raises(CredentialRefused, match="does not accept ZENODO_TOKEN"):
        send(root, service)


def test_root_with_api_and_a_root_that_is_none(root: Path, service: Sandbox) -> None:
    url = service.servers["zenodo"].url
    assert send(root, f"{url}/api")["drafts"] == 1
    (root / "state" / "deposits.json").unlink()
    with pytest.raises(
        FatalError, match=f"pairs: there is no deposit API at {url}/elsewhere"
    ) as caught:
        send(root, f"{url}/elsewhere")
    assert "KB_ZENODO_ENDPOINT" in caught.value.hint


def test_a_limit_without_a_time_is_a_short_wait(root: Path, service: Sandbox) -> None:
    service.faults.add("/api/deposit", status=429, times=3)
    started = monotonic()
    assert send(root, service)["drafts"] == 1
    assert monotonic() - started < 10


def test_a_limit_with_a_date(root: Path, service: Sandbox) -> None:
    def until(seconds: int) -> dict[str, str]:
        return {
            "Retry-After": format_datetime(
                datetime.now(UTC) + timedelta(seconds=seconds), usegmt=True
            )
        }

    service.faults.add("/api/deposit", status=429, headers=until(3))
    started = monotonic()
    assert send(root, service)["drafts"] == 1
    assert 0.9 <= monotonic() - started < 20
    service.faults.add("/api/deposit", status=429, headers=until(3 * 3600))
    with pytest.raises(QuotaSpent):
        send(root, service)
