"""Publishes a release to the simulated hub of tests/services with the real client in a process of
its own.
"""

import json
import sys
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
