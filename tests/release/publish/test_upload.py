"""An upload resumes with the same draft, and is never published twice."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import pytest

from kb.core.errors import (
    CredentialRefused,
    DamagedData,
    FatalError,
    KbError,
    Unreachable,
)
from kb.release.publish.publish import plan, publish
from tests import processes
from tests.conftest import ROOT
from tests.faults import Sandbox
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import build
from tests.release.publish.sending import send, store
from tests.release.signed import LINES, signed
from tests.services.zenodo import TOKEN


def puts(service: Sandbox) -> list[str]:
    return [
        seen.path.rpartition("/")[2]
        for seen in service.ledger.requests("/api/files/")
        if seen.method == "PUT"
    ]


def test_a_plan_counts_what_is_not_uploaded_yet_and_sends_nothing(
    root: Path, service: Sandbox
) -> None:
    endpoint = service.servers["zenodo"].url
    run = a_run(root, kb_zenodo_endpoint=endpoint, zenodo_token=None)
    files = list((root / "release" / "pairs").iterdir())
    planned = plan(run, "zenodo-sandbox", only=["pairs"])["phases"]
    assert [(one["phase"], one["items"]) for one in planned] == [("upload pairs", len(files))]
    assert service.ledger.requests() == []
    send(root, service, publish=True)
    assert plan(run, "zenodo-sandbox", only=["pairs"])["phases"][0]["items"] == 0


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
    with pytest.raises(DamagedData, match=r"deposits\.json is damaged") as caught:
        send(root, service)
    assert "away" not in caught.value.hint  # that would make a second record
    assert service.ledger.requests() == []


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("status", [403, 500])
@pytest.mark.parametrize(
    ("method", "path"),
    [("DELETE", "/files/"), ("POST", "/actions/newversion"), ("GET", "/api/deposit/depositions/")],
)
def test_a_refused_step_of_a_new_version_leads_to_no_second_record(
    root: Path, service: Sandbox, method: str, path: str, status: int
) -> None:
    first = send(root, service, publish=True)["sources"]["pairs"]["id"]
    deposits = store(service)
    deposits.by_id[first].files["old.parquet"] = b"a file that the next version does not have"
    shutil.rmtree(root / "release" / "pairs")
    build(root, sources=("pairs",), n=70)
    release(a_run(root))
    service.faults.add(path, method=method, status=status, times=None)
    with pytest.raises(KbError) as caught:
        send(root, service, publish=True)
    assert not {"away", "deposits.json", "delete"} & set(caught.value.hint.split())
    assert "the same command" in caught.value.hint
    service.faults.clear()
    assert send(root, service, publish=True)["published"] == 1
    assert len(deposits.by_id) == 2  # the record and its new version
    assert len({one.concept for one in deposits.by_id.values()}) == 1


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
