"""A release in one repository of the hub: the real client, a real process, loopback."""

import hashlib
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from kb.release.publish.repository import joined
from kb.store.state import tombstones
from tests import processes
from tests.faults import Sandbox
from tests.inprocess import Done
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import build
from tests.release.publish.hub_sending import (
    REPO,
    command,
    environment,
    held,
    kb,
    publish,
    store,
    summary,
)
from tests.services.hub.repository import Repository, git_blob
from tests.services.hub.service import STRANGER, TOKEN


def stored(service: Sandbox, since: int = 0) -> list[str]:
    """Objects that arrived at the hub, by SHA-256."""
    return [
        one.path.rpartition("/")[2]
        for one in service.ledger.requests("/info/lfs/objects/", since=since)
        if one.method == "PUT" and one.status == 200
    ]


def on_disk(root: Path, folders: Sequence[str] = ()) -> dict[str, str]:
    """File of release/ → SHA-256."""
    release = root / "release"
    return {
        path.relative_to(release).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in release.glob("*/*")
        if path.is_file() and (not folders or path.parent.name in folders)
    }


def changes(service: Sandbox, since: int) -> list[str]:
    """Requests that are no reading."""
    seen = service.ledger.requests(since=since)
    return [f"{one.method} {one.path}" for one in seen if one.method not in ("GET", "HEAD")]


def at_hub(repository: Repository) -> dict[str, str]:
    """File in a folder of the newest revision → SHA-256."""
    return {
        path: hashlib.sha256(file.data).hexdigest()
        for path, file in repository.head.files.items()
        if "/" in path
    }


TO = ("release", "publish", "--to", "huggingface")


VIDEO = "vid00000003"


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three released folders: what a repository does with them, it does with all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KB_NOW", "2026-11-10T00:00:00Z")
        root = build(tmp_path_factory.mktemp("few") / "data", sources=("youtube", "pairs", "tasks"))
        release(a_run(root))
    return root


@pytest.fixture
def root(few: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(few, tmp_path / "data"))


@pytest.fixture
def whole(released: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(released, tmp_path / "data"))


def tombstone(root: Path, service: Sandbox) -> None:
    """A release without a video that was purged."""

    def without(_: str, rows: list[dict[str, Any]]) -> None:
        rows[:] = [row for row in rows if row.get("video_id") != VIDEO]

    names = tuple(path.name for path in sorted((root / "release").iterdir()))
    shutil.rmtree(root / "release")
    build(root, without, names)
    tombstones.add_tombstones(root, "youtube", [(VIDEO, "named")])
    done = kb(service, root, "release")
    assert done.code == 0, done.err


def holds(path: Path, key: str) -> bool:
    return key in json.dumps(pq.read_table(path).to_pylist(), default=str)


READ = """
import json, sys
import datasets
datasets.disable_progress_bars()
repo, names = sys.argv[1], sys.argv[2:]
assert sorted(datasets.get_dataset_config_names(repo)) == sorted(names)
rows = {name: datasets.load_dataset(repo, name, split="train").to_list() for name in names}
streamed = next(iter(datasets.load_dataset(repo, names[0], split="train", streaming=True)))
assert streamed == rows[names[0]][0]
print(json.dumps(rows, default=str, sort_keys=True))
"""


def test_every_file_arrives_once_is_read_back_and_the_token_nowhere(
    whole: Path, hub: Sandbox
) -> None:
    first = publish(hub, whole, "--repo", REPO, "--json")
    assert summary(first)["uploaded"] == len(on_disk(whole)) + 1  # and the root's card
    assert at_hub(held(hub)) == on_disk(whole)
    assert not held(hub).private
    assert held(hub).tags["v1.0.0"] == held(hub).head
    before = len(hub.ledger)
    second = publish(hub, whole, "--json")  # the repository is known from here on
    assert (summary(second)["repository"], summary(second)["uploaded"]) == (REPO, 0)
    assert changes(hub, before) == []
    said = first.out + first.err + second.out + second.err
    files = [path for path in whole.parent.rglob("*") if path.is_file()]
    assert TOKEN not in said
    assert not [path for path in files if TOKEN.encode() in path.read_bytes()]
    assert not [one for one in hub.ledger.requests() if TOKEN in f"{one.path}?{one.query}"]
    held(hub).private = True  # whoever reads it has the token
    shards: dict[str, list[Path]] = {}
    for path in sorted((whole / "release").rglob("*.parquet")):
        shards.setdefault(path.name.partition("-")[0], []).append(path)
    reader = subprocess.run(
        [sys.executable, "-c", READ, REPO, *shards],
        env=environment(hub, whole),
        text=True,
        capture_output=True,
        check=False,
    )
    assert reader.returncode == 0, reader.stderr[-2000:]
    read = json.loads(reader.stdout)
    for name, paths in shards.items():
        rows = [row for path in paths for row in pq.ParquetFile(path).read().to_pylist()]
        assert read[name] == json.loads(json.dumps(rows, default=str)), name


def test_what_was_purged_leaves_the_newest_revision_and_with_squash_all(
    root: Path, hub: Sandbox
) -> None:
    summary(publish(hub, root, "--repo", REPO, "--json"))
    old = on_disk(root)
    tombstone(root, hub)
    done = publish(hub, root)
    assert done.code == 0, done.err
    assert "1 older revision with what was removed since (--squash-history" in done.out
    repository = held(hub)
    assert at_hub(repository) == on_disk(root) != old
    assert not [path for path in root.glob("release/*/*.parquet") if holds(path, VIDEO)]
    assert repository.tags["v1.0.0"] == repository.head  # the version's tag has moved along
    assert len(repository.commits) == 3
    squashed = publish(hub, root, "--squash-history", "--json")
    assert (summary(squashed)["older_revisions"], summary(squashed)["uploaded"]) == (0, 0)
    assert [commit.files for commit in repository.commits] == [repository.head.files]
    assert repository.tags == {"v1.0.0": repository.head}
    named = {file.sha256 for file in repository.head.files.values() if file.sha256}
    assert set(repository.objects) == named  # nothing else is stored there
    before = len(hub.ledger)
    assert publish(hub, root, "--squash-history").code == 0
    assert changes(hub, before) == []


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_upload_resumes_and_sends_no_object_twice(
    root: Path, hub: Sandbox, how: signal.Signals
) -> None:
    objects = len({name for name in on_disk(root) if name.endswith((".parquet", ".tar"))})
    fault = hub.faults.add("/info/lfs/objects/", method="PUT", after=objects // 2, hold=True)
    with subprocess.Popen(
        command(root, *TO, "--repo", REPO),
        env=environment(hub, root),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert fault.arrived.wait(60)
        process.send_signal(how)
        if how is signal.SIGTERM:
            fault.release()
        said = process.communicate()[1]
    fault.release()
    if how is signal.SIGTERM:
        assert (process.returncode, "stopped by SIGTERM" in said) == (3, True)
    assert held(hub).commits[1:] == []  # readers saw nothing of it
    done = publish(hub, root, "--repo", REPO)
    assert done.code == 0, done.err
    assert at_hub(held(hub)) == on_disk(root)
    arrived = stored(hub)
    twice = {one for one in arrived if arrived.count(one) > 1}
    assert len(twice) <= (1 if how is signal.SIGKILL else 0)  # the one on its way


def test_a_run_whose_last_answer_was_lost_makes_no_second_revision(
    root: Path, hub: Sandbox
) -> None:
    def lose(environ: dict[str, Any]) -> bool:
        return environ["REQUEST_METHOD"] == "POST"

    hub.faults.add("/tag/", when=lose, reset=True)
    first = publish(hub, root, "--repo", REPO)
    assert first.code == 4
    assert first.said.startswith("kb: no connection to the hub at http://127.0.0.1:")
    assert len(held(hub).commits) == 2
    done = publish(hub, root, "--repo", REPO)
    assert done.code == 0, done.err
    assert len(held(hub).commits) == 2
    assert held(hub).tags["v1.0.0"] == held(hub).head


def test_a_plan_names_what_would_go_and_sends_nothing(root: Path, hub: Sandbox) -> None:
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    plan = summary(publish(hub, root, "--repo", REPO, "--plan", "--json", HF_TOKEN=""))
    items = {one["phase"]: one["items"] for one in plan["phases"]}
    assert sum(items.values()) == len(on_disk(root)) + 1
    assert items["upload pairs"] == len(on_disk(root, ["pairs"]))
    assert (plan["repository"], plan["tag"]) == (REPO, "v1.0.0")
    assert len(hub.ledger) == 0
    assert before == {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    summary(publish(hub, root, "--repo", REPO, "--json"))
    again = summary(publish(hub, root, "--plan", "--json"))
    assert {one["items"] for one in again["phases"] if one["phase"] != "revision and tag"} == {0}


def test_only_one_folder_leaves_the_others_as_they_are(root: Path, hub: Sandbox) -> None:
    summary(publish(hub, root, "--repo", REPO, "--json"))
    card = held(hub).head.files["README.md"]
    shutil.rmtree(root / "release" / "tasks")
    summary(publish(hub, root, "--only", "pairs", "--json"))
    assert held(hub).head.files["README.md"] == card
    assert "tasks/SHA256SUMS" in held(hub).head.files


def test_a_private_repository_stays_private(root: Path, hub: Sandbox) -> None:
    summary(publish(hub, root, "--repo", REPO, "--private", "--only", "pairs", "--json"))
    assert held(hub).private
    summary(publish(hub, root, "--only", "pairs", "--json"))
    assert held(hub).private
    held(hub).private = False
    done = publish(hub, root, "--private", "--only", "pairs")
    assert done.code == 1
    assert done.said.startswith(f"kb: {REPO} is public already")


def test_a_repository_of_something_else_is_left_alone(root: Path, hub: Sandbox) -> None:
    summary(publish(hub, root, "--repo", REPO, "--only", "pairs", "--json"))
    other = "sandbox-lab/pictures"
    store(hub).repositories[other] = held(hub)
    held(hub, other).commit({"train.csv": git_blob(b"a,b")}, "mine", "", "sandbox")
    done = publish(hub, root, "--repo", other, "--only", "pairs")
    assert done.code == 1
    assert (
        "the name sandbox-lab/pictures is taken: it contains files that are not a release"
        in done.said
    )
    assert list(held(hub, other).head.files) == ["train.csv"]


def test_a_published_release_is_read_where_it_lies(root: Path, hub: Sandbox) -> None:
    """By a process of its own, with the token and without it."""
    assert publish(hub, root, "--repo", REPO, "--private").code == 0
    before = len(hub.ledger)
    asked = ("query", "SELECT count(*) AS n FROM youtube_videos", "--format", "csv")
    place = ("--data", f"hf://datasets/{REPO}")
    read = at_address(hub, root, *asked, *place)
    assert (read.code, read.err) == (0, "")
    assert read.out == at_address(hub, root, *asked, "--data", str(root / "release")).out
    listed = at_address(hub, root, "query", "--tables", *place)
    assert "release.youtube_videos" in listed.out
    assert changes(hub, before) == []
    tagged = at_address(hub, root, *asked, "--data", f"hf://datasets/{REPO}@v1.0.0")
    assert tagged.out == read.out
    blocks = {"FSSPEC_BLOCKCACHE_CACHE_STORAGE": str(root.parent / "blocks")}
    cached = at_address(hub, root, *asked, "--data", f"blockcache::hf://datasets/{REPO}", **blocks)
    assert (cached.out, cached.err) == (read.out, "")
    assert any((root.parent / "blocks").iterdir())
    refused = at_address(hub, root, *asked, *place, HF_TOKEN=STRANGER)
    assert refused.code in (1, 2)
    assert refused.err.startswith(f"kb: there is no hf://datasets/{REPO}; ")
    unknown = at_address(hub, root, *asked, *place, HF_TOKEN="hf_unknown0000000")
    assert unknown.code == 1
    assert unknown.err.startswith(f"kb: hf://datasets/{REPO}: no permission to read it (")
    assert "HF_TOKEN" in unknown.err.partition("; ")[2]
    crawl = at_address(hub, root, "status", *place)
    assert (crawl.code, "reads no addresses" in crawl.err) == (2, True)


def at_address(service: Sandbox, root: Path, *words: str, **env: str) -> Done:
    """`kb WORDS` in an empty folder, with the hub's address and token."""
    empty = root.parent / "elsewhere"
    empty.mkdir(exist_ok=True)
    fresh = any(name.startswith("FSSPEC_") for name in env)  # fsspec reads them at its import
    done = processes.run(words, env=environment(service, root, **env), cwd=empty, fresh=fresh)
    assert list(empty.iterdir()) == []
    return Done(done.returncode, done.stdout, done.stderr)


SHARDS = [{"split": "train", "path": "posts-*-of-*.parquet"}]


REDDIT = {
    "license": "cc-by-4.0",
    "tags": ["minecraft", "reddit"],
    "size_categories": ["1M<n<10M"],
    "configs": [{"config_name": "posts", "default": True, "data_files": SHARDS}],
    "dataset_info": {"splits": [{"name": "train", "num_examples": 3}]},
}


TASKS = {
    "license": ["cc-by-4.0", "cc0-1.0"],
    "tags": ["minecraft"],
    "size_categories": ["n<1K"],
    "configs": [
        {
            "config_name": "tasks",
            "default": True,
            "data_files": [{"split": "train", "path": ["a.parquet", "b.parquet"]}],
        }
    ],
    "dataset_info": [{"config_name": "tasks", "splits": []}],
}


def test_configs_name_their_folders_and_one_is_the_default() -> None:
    whole = joined("Minecraft", {"reddit": REDDIT, "tasks": TASKS})
    assert whole["configs"] == [
        {
            "config_name": "posts",
            "default": True,
            "data_files": [{"split": "train", "path": "reddit/posts-*-of-*.parquet"}],
        },
        {
            "config_name": "tasks",
            "data_files": [{"split": "train", "path": ["tasks/a.parquet", "tasks/b.parquet"]}],
        },
    ]
    assert [one["config_name"] for one in whole["dataset_info"]] == ["posts", "tasks"]
    assert whole["license"] == ["cc-by-4.0", "cc0-1.0"]
    assert whole["tags"] == ["minecraft", "reddit"]
    assert whole["size_categories"] == ["1M<n<10M"]
