"""Publishes a release to the simulated hub of tests/services with the real client in a process of
its own.
"""

import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests import processes
from tests.cli.conftest import clean_environment
from tests.faults import Sandbox
from tests.inprocess import Done
from tests.release.signed import signed
from tests.services.hub.repository import Repository
from tests.services.hub.service import HubService

REPO = "sandbox-lab/minecraft"
NOW = {"KB_NOW": "2026-11-10T00:00:00Z"}


def store(service: Sandbox) -> HubService:
    return service.applications["hub"]


def held(service: Sandbox, name: str = REPO) -> Repository:
    return store(service).repositories[name]


def environment(service: Sandbox, root: Path, **more: str) -> dict[str, str]:
    own = {"HF_HOME": str(root.parent / "hf"), "HOME": str(root.parent)}
    return {**clean_environment(), **service.settings(), **NOW, **own, **more}


def command(root: Path, *words: str) -> list[str]:
    place = ["--data", str(root), "--profile", str(signed())]
    return [sys.executable, "-m", "kb", *words, *place]


def kb(service: Sandbox, root: Path, *words: str, **env: str) -> Done:
    """`kb WORDS` to its end."""
    _, _, _, *arguments = command(root, *words)
    done = processes.run(arguments, env=environment(service, root, **env), cwd=root.parent)
    return Done(done.returncode, done.stdout, done.stderr)


def publish(service: Sandbox, root: Path, *words: str, **env: str) -> Done:
    """`kb release publish --to huggingface`."""
    return kb(service, root, "release", "publish", "--to", "huggingface", *words, **env)


def summary(done: Done) -> dict[str, Any]:
    """The last line on stdout of a command with --json."""
    assert done.code == 0, done.err
    return json.loads(done.out.splitlines()[-1])


def on_disk(root: Path, folders: Sequence[str] = ()) -> dict[str, str]:
    """File of release/ → SHA-256."""
    release = root / "release"
    return {
        path.relative_to(release).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in release.glob("*/*")
        if path.is_file() and (not folders or path.parent.name in folders)
    }


def at_hub(repository: Repository) -> dict[str, str]:
    """File in a folder of the newest revision → SHA-256."""
    return {
        path: hashlib.sha256(file.data).hexdigest()
        for path, file in repository.head.files.items()
        if "/" in path
    }


def stored(service: Sandbox, since: int = 0) -> list[str]:
    """Objects that arrived at the hub, by SHA-256."""
    return [
        one.path.rpartition("/")[2]
        for one in service.ledger.requests("/info/lfs/objects/", since=since)
        if one.method == "PUT" and one.status == 200
    ]


def changes(service: Sandbox, since: int) -> list[str]:
    """Requests that are no reading."""
    seen = service.ledger.requests(since=since)
    return [f"{one.method} {one.path}" for one in seen if one.method not in ("GET", "HEAD")]
