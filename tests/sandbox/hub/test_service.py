"""The hub as the real client and its file system see it."""

import hashlib
from collections.abc import Iterator
from typing import Any

import pytest
from huggingface_hub import (
    CommitOperationAdd,
    CommitOperationDelete,
    HfApi,
    HfFileSystem,
    RepoFile,
    constants,
)
from huggingface_hub.errors import (
    BadRequestError,
    EntryNotFoundError,
    HfHubHTTPError,
    RepositoryNotFoundError,
    RevisionNotFoundError,
)

from kb.sandbox.hub.service import READER, STRANGER, TOKEN
from tests.faults import Sandbox

REPO, KIND = "sandbox-lab/things", "dataset"
LARGE = bytes(range(256)) * 100
WHERE = f"datasets/{REPO}"


@pytest.fixture
def sandbox(monkeypatch: pytest.MonkeyPatch) -> Iterator[Sandbox]:
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setenv("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    with Sandbox(services=["hub"]) as one:
        yield one


def api(sandbox: Sandbox, token: str | bool = TOKEN) -> HfApi:
    return HfApi(endpoint=sandbox.servers["hub"].url, token=token)


def files(sandbox: Sandbox, token: str = TOKEN) -> Any:
    url = sandbox.servers["hub"].url
    return HfFileSystem(endpoint=url, token=token, skip_instance_cache=True)


def filled(sandbox: Sandbox, *, private: bool = False) -> str:
    """A repository with a git blob and an LFS object; its revision."""
    client = api(sandbox)
    client.create_repo(REPO, repo_type=KIND, private=private)
    added = [
        CommitOperationAdd("a/notes.txt", b"notes"),
        CommitOperationAdd("a/b/large.parquet", LARGE),
    ]
    return str(client.create_commit(REPO, added, commit_message="one", repo_type=KIND).oid)


@pytest.mark.parametrize("part", [10_000, 2**20])
def test_an_object_arrives_whole_in_one_request_or_in_parts(sandbox: Sandbox, part: int) -> None:
    sandbox.applications["hub"].part = part
    filled(sandbox)
    tree = api(sandbox).list_repo_tree(REPO, repo_type=KIND, recursive=True)
    found = {one.path: one for one in tree if isinstance(one, RepoFile)}
    assert found["a/b/large.parquet"].lfs is not None
    assert found["a/b/large.parquet"].lfs.sha256 == hashlib.sha256(LARGE).hexdigest()
    assert found["a/notes.txt"].lfs is None
    assert found["a/notes.txt"].blob_id == hashlib.sha1(b"blob 5\0notes").hexdigest()
    assert files(sandbox).cat_file(f"{WHERE}/a/b/large.parquet") == LARGE


def test_ranges_are_read_alone(sandbox: Sandbox) -> None:
    filled(sandbox)
    there = files(sandbox)
    before = len(sandbox.ledger)
    assert there.cat_file(f"{WHERE}/a/b/large.parquet", start=300, end=310) == LARGE[300:310]
    assert {one.status for one in sandbox.ledger.requests("/resolve/", since=before)} == {206}
    with there.open(f"{WHERE}/a/b/large.parquet", block_size=100) as file:
        file.seek(-4, 2)
        assert file.read() == LARGE[-4:]
    assert there.glob(f"{WHERE}/**/*.parquet") == [f"{WHERE}/a/b/large.parquet"]
    assert there.ls(f"{WHERE}/a", detail=False) == [f"{WHERE}/a/b", f"{WHERE}/a/notes.txt"]


def test_a_long_tree_comes_in_pages(sandbox: Sandbox, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kb.sandbox.hub.repository.TREE_PAGE", 2)
    filled(sandbox)
    tree = api(sandbox).list_repo_tree(REPO, repo_type=KIND, recursive=True)
    assert sorted(one.path for one in tree) == [
        ".gitattributes",
        "a",
        "a/b",
        "a/b/large.parquet",
        "a/notes.txt",
    ]


def test_older_revisions_and_tags_stay_until_the_history_is_squashed(sandbox: Sandbox) -> None:
    first, client = filled(sandbox), api(sandbox)
    client.create_tag(REPO, tag="v1/a", repo_type=KIND)
    removed = [CommitOperationDelete("a/notes.txt")]
    client.create_commit(REPO, removed, commit_message="two", repo_type=KIND)
    for revision in (first, "v1%2Fa"):
        assert files(sandbox).cat_file(f"{WHERE}@{revision}/a/notes.txt") == b"notes"
    assert not files(sandbox).exists(f"{WHERE}/a/notes.txt")
    client.super_squash_history(REPO, repo_type=KIND)
    assert len(client.list_repo_commits(REPO, repo_type=KIND)) == 1
    assert client.repo_info(REPO, repo_type=KIND, revision="v1/a").sha == first
    client.delete_tag(REPO, tag="v1/a", repo_type=KIND)
    with pytest.raises(RevisionNotFoundError):
        client.repo_info(REPO, repo_type=KIND, revision=first)


def test_a_stale_parent_and_an_object_that_never_came_are_refused(sandbox: Sandbox) -> None:
    first, client = filled(sandbox), api(sandbox)
    change = [CommitOperationAdd("c.txt", b"c")]
    client.create_commit(REPO, change, commit_message="two", repo_type=KIND)
    with pytest.raises(HfHubHTTPError) as caught:
        client.create_commit(
            REPO,
            [CommitOperationAdd("d.txt", b"d")],
            commit_message="three",
            repo_type=KIND,
            parent_commit=first,
        )
    assert caught.value.response.status_code == 412
    lost = CommitOperationAdd("e.parquet", b"\0lost")
    lost._upload_mode, lost._is_uploaded = "lfs", True
    with pytest.raises(BadRequestError, match="was not uploaded"):
        client.create_commit(REPO, [lost], commit_message="four", repo_type=KIND)


def test_a_token_decides_what_is_there_and_what_may_be_done(sandbox: Sandbox) -> None:
    filled(sandbox, private=True)
    for token in (STRANGER, False):
        with pytest.raises(RepositoryNotFoundError):
            api(sandbox, token).repo_info(REPO, repo_type=KIND)
    reader = api(sandbox, READER)
    assert reader.repo_info(REPO, repo_type=KIND).private
    with pytest.raises(EntryNotFoundError):
        reader.hf_hub_download(REPO, "no", repo_type=KIND)
    with pytest.raises(HfHubHTTPError, match="write access"):
        reader.create_tag(REPO, tag="v1", repo_type=KIND)
    with pytest.raises(HfHubHTTPError, match="Invalid user token"):
        api(sandbox, "hf_nobody00000").whoami()
    with pytest.raises(HfHubHTTPError, match="already created"):
        api(sandbox).create_repo(REPO, repo_type=KIND)
