"""Tests of `kb.release.publish.zenodo`."""

from pathlib import Path

import pytest

from kb.core.errors import (
    Interrupted,
)
from kb.sandbox.zenodo import TOKEN
from tests.faults import Sandbox


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
