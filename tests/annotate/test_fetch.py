"""`kb models fetch` against a loopback host: verified, resumable, with clear exit codes."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from kb.annotate.fetch import fetch
from kb.core import clock
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, MissingModel, SettingError, Unreachable
from kb.net.bounded import PART
from kb.store.checkpoint import PUBLISHED, Published, find_checkpoint

BIG = hashlib.sha256(b"seed").digest() * 100_000  # 3.2 MB
KEPT = len(BIG) // 2 // PART * PART  # of a download that is cut in the middle
SMALL = b'{"model_type": "bert"}'
VOCAB = b"[PAD]\n[UNK]\n"


def digest(data):
    return hashlib.sha256(data).hexdigest()


MODEL = Published(
    "mine",
    "v0",
    f"mine-{digest(BIG)[:8]}.ckpt",
    digest(BIG),
    "org/base",
    "abc123",
    (("config.json", digest(SMALL)), ("vocab.txt", "")),
)


class Host:
    """Serves three files with ranges; `faults` maps a path's end to a list of what happens next."""

    def __init__(self):
        self.files = {
            "/org/base/resolve/abc123/config.json": SMALL,
            "/org/base/resolve/abc123/vocab.txt": VOCAB,
            f"/unitaryai/detoxify/releases/download/v0/{MODEL.checkpoint}": BIG,
        }
        self.faults: dict[str, list[str]] = {}
        self.requests: list[tuple[str, str | None]] = []
        host = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self):
                host.requests.append((self.path.rpartition("/")[2], self.headers.get("Range")))
                host.answer(self)

            def log_message(self, *arguments):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def answer(self, to):
        data, fault = self.files.get(to.path), None
        for end, faults in self.faults.items():
            if to.path.endswith(end) and faults:
                fault = faults.pop(0)
        start = int((to.headers.get("Range") or "bytes=0-")[6:-1])
        if data is None or fault in ("503", "403"):
            to.send_response(int(fault or 404))
            to.send_header("Content-Length", "0")
            to.end_headers()
            return
        if start >= len(data) > 0 and start:
            to.send_response(416)
            to.send_header("Content-Range", f"bytes */{len(data)}")
            to.send_header("Content-Length", "0")
            to.end_headers()
            return
        body = data[start:]
        to.send_response(206 if start else 200)
        if start:
            to.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
        to.send_header("Content-Length", str(len(body)))
        to.end_headers()
        if fault == "cut":
            to.wfile.write(body[: len(body) // 2])
            to.close_connection = True
            return
        to.wfile.write(body)


@pytest.fixture
def host():
    served = Host()
    yield served
    served.server.shutdown()
    served.server.server_close()


@pytest.fixture
def run(host, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # Backoff is counted, not waited for.
    monkeypatch.setattr(clock, "sleep", lambda seconds: None)
    return Run(
        settings=load_settings(dotenv=False, kb_models_endpoint=host.url),
        profile=load_profile("minecraft"),
        root=tmp_path / "data",
    )


def test_files_come_verified_and_only_once(run, host):
    first = fetch(run, published=MODEL)
    assert (first["fetched"], first["present"], first["bytes"]) == (
        3,
        0,
        len(BIG) + len(SMALL) + len(VOCAB),
    )
    assert [name for name, _ in host.requests] == ["config.json", "vocab.txt", MODEL.checkpoint]
    assert fetch(run, published=MODEL)["fetched"] == 0
    assert len(host.requests) == 3
    assert not list((run.root.parent / "cache").rglob("*.part"))


def test_a_cut_download_goes_on_where_it_ended(run, host):
    host.faults[".ckpt"] = ["cut"]
    assert fetch(run, published=MODEL)["fetched"] == 3
    ranges = [asked for name, asked in host.requests if name == MODEL.checkpoint]
    assert ranges == [None, f"bytes={KEPT}-"]


def test_an_unreachable_host_is_exit_4_and_keeps_the_part(run, host):
    host.faults[".ckpt"] = ["cut"] + ["503"] * 4
    with pytest.raises(Unreachable) as error:
        fetch(run, published=MODEL)
    assert error.value.exit_code == 4
    fetch(run, published=MODEL)
    assert host.requests[-1] == (MODEL.checkpoint, f"bytes={KEPT}-")


def test_another_file_is_exit_1_and_nothing_of_it_stays(run, host):
    host.files[f"/unitaryai/detoxify/releases/download/v0/{MODEL.checkpoint}"] = BIG[:-1] + b"x"
    with pytest.raises(DamagedData) as error:
        fetch(run, published=MODEL)
    assert error.value.exit_code == 1
    assert "KB_MODELS_ENDPOINT" in error.value.hint
    assert sorted(
        path.name for path in (run.root.parent / "cache").rglob("*") if path.is_file()
    ) == [
        "config.json",
        "vocab.txt",
    ]


def test_a_part_of_another_file_is_started_over(run, host, tmp_path):
    folder = tmp_path / "cache/lorecrawl/models/mine"
    folder.mkdir(parents=True)
    (folder / f".{MODEL.checkpoint}.part").write_bytes(b"x" * 1000)
    assert fetch(run, published=MODEL)["fetched"] == 3
    (folder / MODEL.checkpoint).unlink()
    (folder / f".{MODEL.checkpoint}.part").write_bytes(BIG + b"more")
    assert fetch(run, published=MODEL)["fetched"] == 1


@pytest.mark.parametrize("fault", ["403", "404"])
def test_a_refused_or_absent_file_is_exit_1(run, host, fault):
    if fault == "404":
        host.files.clear()
    host.faults["config.json"] = ["403"] if fault == "403" else []
    with pytest.raises(FatalError, match=fault):
        fetch(run, published=MODEL)


def test_unknown_model_is_exit_2(run):
    with pytest.raises(SettingError, match="nonesuch"):
        fetch(run, "nonesuch")


def test_what_was_fetched_is_found_and_a_broken_one_names_the_command(run, monkeypatch):
    monkeypatch.setitem(PUBLISHED, "mine", MODEL)
    chosen = load_settings(dotenv=False, kb_toxicity_model="mine")
    with pytest.raises(MissingModel, match="is not installed") as error:
        find_checkpoint(chosen)
    assert "kb models fetch mine" in error.value.hint
    fetch(run, "mine")
    found = find_checkpoint(chosen)
    assert (found.model, found.sha256) == ("mine", digest(BIG))
    found.path.write_bytes(BIG[:1000])
    with pytest.raises(MissingModel, match="checksum mismatch") as error:
        find_checkpoint(chosen)
    assert error.value.exit_code == 2
    assert "kb models fetch mine" in error.value.hint


PAGE = b"<html>Please log in to the network of this hotel</html>"
UNPINNED = Published(
    "unpinned",
    "v0",
    MODEL.checkpoint,
    digest(BIG),
    "org/base",
    "abc123",
    tuple((name, "") for name in ("config.json", "merges.txt", "vocab.txt")),
)


@pytest.mark.parametrize("name", ["config.json", "merges.txt", "vocab.txt"])
def test_a_log_in_page_is_no_file_of_a_model(host, run, name):
    """It answers 200, and these files have no published digest."""
    folder = "/org/base/resolve/abc123/"
    host.files[f"{folder}merges.txt"] = b"#version: 0.2\na b\n"
    good = host.files[folder + name]
    host.files[folder + name] = PAGE
    with pytest.raises(DamagedData, match=name) as error:
        fetch(run, published=UNPINNED)
    assert error.value.exit_code == 1
    host.files[folder + name] = good
    # One that was kept all the same is fetched again.
    kept = Path(fetch(run, published=UNPINNED)["folder"])
    (kept / name).write_bytes(PAGE)
    again = fetch(run, published=UNPINNED)
    assert (again["fetched"], again["present"]) == (1, 3)
    assert (kept / name).read_bytes() == good
