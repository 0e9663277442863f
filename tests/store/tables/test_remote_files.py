"""Folders at addresses: what is read of them, and what is said of those that can't be read."""

import contextlib
import hashlib
import sys
import tarfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from werkzeug import Request, Response
from werkzeug.serving import make_server
from werkzeug.utils import send_file

import kb
from kb.core.errors import DamagedData, FatalError, MissingExtra, SettingError, Unreachable
from kb.store.tables import remote_files
from kb.store.tables.remote_files import RemoteFolder, reading_at, remote_folders
from tests.store.tables.bucket import S3Server
from tests.store.tables.many_comments import SHARDS, write_comments


@pytest.fixture(scope="module")
def server() -> Iterator[S3Server]:
    with S3Server().running() as one:
        yield one


@pytest.fixture(scope="module")
def folder(make_rows, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_comments(tmp_path_factory.mktemp("reddit"), make_rows)


@pytest.fixture(scope="module")
def address(server: S3Server, folder: Path) -> str:
    return server.fill("lore", folder, "v1/reddit/")


def opened(server: S3Server, address: str, **more: object) -> RemoteFolder:
    (one,) = remote_folders(address, server.options(**more))
    return one


def test_a_look_up_reads_at_most_a_twentieth_of_the_bytes(
    server: S3Server, address: str, folder: Path
) -> None:
    size = sum(path.stat().st_size for path in folder.iterdir())
    rows = opened(server, address).dataset(SHARDS)
    before = server.answered
    found = rows.to_table(filter=pc.field("post_id") == "k0123456")
    assert found["post_id"].to_pylist() == ["k0123456"]
    assert 0 < server.answered - before <= size / 20
    assert server.methods <= {"GET", "HEAD"}


def test_files_are_verified_and_pages_as_they_are_read(
    server: S3Server, folder: Path, tmp_path: Path
) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "profile.toml").write_text("name = 'y'\n")
    chunk = pq.read_metadata(tmp_path / SHARDS[1]).row_group(30).column(0)
    data = bytearray((tmp_path / SHARDS[1]).read_bytes())
    at = chunk.data_page_offset + chunk.total_compressed_size // 2
    data[at] ^= 1
    (tmp_path / SHARDS[1]).write_bytes(data)
    address = server.fill("changed", tmp_path)
    one = opened(server, address)
    with pytest.raises(DamagedData, match=r"s3://changed/profile\.toml can't be read: checksum"):
        one.read_file("profile.toml")
    rows = one.dataset(SHARDS)
    assert rows.to_table(filter=pc.field("post_id") == "k0000007").num_rows == 1
    with pytest.raises(DamagedData, match=r"s3://changed.*: .*page"), reading_at(str(one)):
        rows.to_table()


def test_blocks_are_kept_only_in_a_folder_that_the_address_names(
    server: S3Server, address: str, tmp_path: Path
) -> None:
    cache = tmp_path / "blocks"
    options = {
        "s3": server.options(),
        "blockcache": {"cache_storage": str(cache), "skip_instance_cache": True},
    }
    answered = []
    for _ in range(2):
        (one,) = remote_folders(f"blockcache::{address}", options)
        before = server.answered
        found = one.dataset(SHARDS).to_table(filter=pc.field("post_id") == "k0000007")
        assert found.num_rows == 1
        answered.append(server.answered - before)
    assert answered[1] < answered[0]
    assert any(cache.iterdir())


@pytest.mark.parametrize("cache", ["blockcache", "filecache", "simplecache"])
def test_threads_share_a_cache(server: S3Server, cache: str, tmp_path: Path) -> None:
    options = {
        "s3": server.options(),
        cache: {"cache_storage": str(tmp_path / "kept"), "skip_instance_cache": True},
    }
    total = write_numbers(tmp_path / "numbers")
    address = server.fill(cache, tmp_path / "numbers", "v1/")
    (one,) = remote_folders(f"{cache}::{address}", options)
    assert sums_of_two_scans(one) == (total, total)


def test_threads_share_an_archive(tmp_path: Path) -> None:
    total = write_numbers(tmp_path / "numbers")
    with tarfile.open(tmp_path / "v1.tar", "w") as archive:
        archive.add(tmp_path / "numbers", "numbers")
    (one,) = remote_folders(f"tar://numbers::file://{tmp_path / 'v1.tar'}")
    assert sums_of_two_scans(one) == (total, total)


def write_numbers(folder: Path) -> int:
    """Eight files that several threads read at once; the sum of their numbers."""
    folder.mkdir()
    for name in range(8):
        rows = pa.table({"number": range(name, 200_000)})
        pq.write_table(rows, folder / f"{name}.parquet", row_group_size=20_000, compression="none")
    return sum(sum(range(name, 200_000)) for name in range(8))


def sums_of_two_scans(folder: RemoteFolder) -> Any:
    """Of the same files, in one query."""
    with duckdb.connect() as con:
        for name in ("a", "b"):
            con.register(name, folder.dataset(sorted(folder.sizes)))
        sums = "SELECT (SELECT sum(number) FROM a), (SELECT sum(number) FROM b)"
        return con.execute(sums).fetchone()


def test_errors_name_the_address(
    server: S3Server, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SettingError, match="there is no s3://lore/v2"):
        remote_folders("s3://lore/v2", server.options())
    with pytest.raises(SettingError, match="there is no s3://nowhere"):
        remote_folders("s3://nowhere", server.options())
    with pytest.raises(SettingError, match="ftpx://x: Protocol not known"):
        remote_folders("ftpx://x")
    with pytest.raises(Unreachable, match=r"s3://lore.* can't be read"):
        remote_folders(
            address,
            server.options(
                client_kwargs={"endpoint_url": "http://127.0.0.1:9"},
                config_kwargs={"retries": {"max_attempts": 0}},
            ),
        )
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    with pytest.raises(FatalError, match=r"s3://lore.*: no permission to read it") as caught:
        remote_folders(address, server.options(key=None, secret=None))
    assert "AWS_ACCESS_KEY_ID" in caught.value.hint
    with pytest.raises(FatalError, match=r"can't be read|no permission"):
        remote_folders(address, server.options(key=None, secret=None))


def test_the_extra_that_an_address_needs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    with pytest.raises(MissingExtra, match=r"s3a://lore: .*s3fs") as caught:
        remote_folders("s3a://lore")  # not loaded yet, as s3:// is
    assert ".[s3]" in caught.value.hint


def test_small_files_are_read_whole(server: S3Server, address: str, folder: Path) -> None:
    one = opened(server, address)
    assert hashlib.sha256(one.read_file("profile.toml")).hexdigest() == one.sums["profile.toml"]
    assert one.sizes == {path.name: path.stat().st_size for path in folder.iterdir()}


asked: list[tuple[str, str]] = []  # of web servers: method and file


@contextlib.contextmanager
def web_server(folder: Path, *, ranges: bool = True) -> Iterator[str]:
    """The address of a folder on a web server that lists names and sends ranges, or does not."""

    @Request.application
    def serve(request: Request) -> Response:
        asked.append((request.method, request.path.rpartition("/")[2]))
        path = folder / request.path.strip("/")
        if path.is_dir():
            names = [one.name + "/" * one.is_dir() for one in path.iterdir()]
            links = "".join(f'<a href="{name}">{name}</a>' for name in names)
            return Response(f"<a href='../'>..</a>{links}", mimetype="text/html")
        if not ranges:
            return Response(path.read_bytes(), mimetype="application/octet-stream")
        return send_file(path, request.environ, conditional=True)

    asked.clear()
    server = make_server("127.0.0.1", 0, serve, threaded=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.port}"
    server.shutdown()


def test_a_web_servers_listing_without_sizes_is_a_release_like_others(
    folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "reddit").mkdir()
    for path in folder.iterdir():
        (tmp_path / "reddit" / path.name).write_bytes(path.read_bytes())
    with web_server(tmp_path) as address:
        (one,) = remote_folders(f"{address}/reddit")
        assert one.sizes == {path.name: path.stat().st_size for path in folder.iterdir()}
        found = one.dataset(SHARDS).to_table(filter=pc.field("post_id") == "k0123456")
        assert found.num_rows == 1


def test_a_web_server_without_ranges_is_read_once_up_to_a_limit(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "reddit").mkdir()
    for path in folder.iterdir():
        (tmp_path / "reddit" / path.name).write_bytes(path.read_bytes())
    with web_server(tmp_path, ranges=False) as address:
        data = kb.load(f"{address}/reddit")
        rows = data["reddit_comments"].to_table()
        assert rows.equals(kb.load(folder)["reddit_comments"].to_table())
        assert len(data.sql("FROM reddit_comments WHERE post_id = 'k0123456'")) == 1
        assert all(asked.count(("GET", name)) == 1 for name in SHARDS)
        monkeypatch.setattr(remote_files, "MOST_COPIED", 1_000_000)
        with pytest.raises(FatalError, match=r"sends whole files only.* at most 1\.0 MB") as caught:
            kb.load(f"{address}/reddit")["reddit_comments"].to_table()
        assert "download the release" in caught.value.hint
