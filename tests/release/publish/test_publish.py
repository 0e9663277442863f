"""Publishing to a loopback service that behaves as the documented API."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import duckdb
import pytest

from kb.core.errors import (
    FatalError,
    ReleaseRefused,
)
from tests.faults import Sandbox
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.publish.sending import send, store
from tests.services.zenodo import TOKEN


def test_a_draft_for_each_folder_with_every_file(root: Path, service: Sandbox) -> None:
    summary = send(root, service, only="")
    assert (summary["deposits"], summary["drafts"], summary["published"]) == (6, 6, 0)
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


def test_too_many_files_for_a_record(root: Path, service: Sandbox) -> None:
    folder = root / "release" / "pairs"
    for number in range(100):
        (folder / f"extra-{number}.tar").write_bytes(b"x")
    with pytest.raises(ReleaseRefused) as caught:
        send(root, service)
    assert any(
        line.startswith("size: pairs: 115 files, a record takes 100")
        for line in caught.value.problems
    )


def test_second_publisher_is_told_of_the_first(root: Path, service: Sandbox) -> None:
    from kb.core.errors import WriterLocked
    from kb.store.lock import writer

    with writer(root, "deposits"), pytest.raises(WriterLocked, match=f"pid {os.getpid()}"):
        send(root, service)


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
