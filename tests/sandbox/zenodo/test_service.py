"""Tests of the sandbox's deposit service."""

import hashlib

import requests

from kb.sandbox.zenodo import TOKEN
from tests.faults import Sandbox
from tests.sandbox.answers import GOOD


def test_a_deposit_from_draft_to_record() -> None:
    with Sandbox(services=["zenodo"]) as sandbox:
        place = f"{sandbox.servers['zenodo'].url}/api/deposit/depositions"
        assert requests.get(place, timeout=9).status_code == 401
        other = {"Authorization": "Bearer another"}
        assert requests.get(place, headers=other, timeout=9).status_code == 403
        session = requests.Session()
        session.headers["Authorization"] = f"Bearer {TOKEN}"
        draft = session.post(place, json={"metadata": GOOD}, timeout=9).json()
        assert draft["state"] == "unsubmitted"
        publish = draft["links"]["publish"]
        assert session.post(publish, timeout=9).status_code == 400  # it has no file
        put = session.put(f"{draft['links']['bucket']}/a.txt", data=b"bytes", timeout=9)
        assert put.json()["checksum"] == f"md5:{hashlib.md5(b'bytes').hexdigest()}"
        published = session.post(publish, timeout=9)
        assert published.status_code == 202
        assert published.json()["doi"] == f"10.5072/zenodo.{draft['id']}"
        record = f"{sandbox.servers['zenodo'].url}/api/records/{draft['id']}"
        (file,) = requests.get(record, timeout=9).json()["files"]
        assert requests.get(file["links"]["self"], timeout=9).content == b"bytes"
