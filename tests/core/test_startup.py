"""Dependencies that report by themselves are switched off before they start; and the trap."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kb.core.errors import MissingExtra
from kb.wiki.browser import chromium
from tests import trap
from tests.conftest import ROOT, skip_or_fail


def test_onnx_runtime_is_told_before_it_is_imported(tmp_path: Path) -> None:
    """Whether its reporter starts at all hangs on the machine: the switch must always be set."""
    pytest.importorskip("onnxruntime")
    home = tmp_path / "home"
    home.mkdir()
    env = {name: value for name, value in os.environ.items() if "TELEMETRY" not in name}
    env |= {"HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(ROOT)}
    code = "import kb, os; assert os.environ['ORT_DISABLE_TELEMETRY'] == '1'; import onnxruntime"
    subprocess.run([sys.executable, "-c", code], env=env, check=True)
    assert [path.name for path in home.rglob("*") if path.is_file()] == []


def test_libraries_of_the_hub_are_told_before_they_are_imported() -> None:
    pytest.importorskip("huggingface_hub")
    code = (
        "import kb; from huggingface_hub import constants; "
        "raise SystemExit(not constants.HF_HUB_DISABLE_TELEMETRY)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_trap_sees_the_browser_too(tmp_path: Path) -> None:
    """Or its silence in the demo would show nothing."""
    try:
        browser = chromium.find_programs().browser
    except MissingExtra as error:
        skip_or_fail(str(error))
    if trap.namespace() is None:
        pytest.skip("no network namespace can be made here")
    record = tmp_path / "record"
    command = [browser, "--headless=new", "--no-sandbox", f"--user-data-dir={tmp_path}/profile"]
    trap.run(
        [*command, "--disable-gpu", "--dump-dom", "http://tried.invalid/"],
        record,
        {**os.environ, "HOME": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    assert any(line.endswith(" tried.invalid") for line in trap.attempts(record))


@pytest.mark.parametrize("run", [trap.run, trap.run_watched])
def test_the_trap_sees_what_is_tried(run, tmp_path: Path) -> None:
    """A name, a connection and a datagram are told; loopback is not."""
    code = (
        "import contextlib, socket\n"
        "own, tcp, udp = ('127.0.0.1', 9), ('192.0.2.1', 81), ('192.0.2.2', 82)\n"
        "for kind, address in ((1, own), (1, tcp), (2, udp)):\n"
        "    with contextlib.suppress(OSError), socket.socket(2, kind) as held:\n"
        "        held.settimeout(0.5)\n"
        "        held.connect(address)\n"
        "        held.send(b'x')\n"
        "with contextlib.suppress(OSError):\n"
        "    socket.getaddrinfo('tried.invalid', 80)\n"
    )
    record = tmp_path / "record"
    assert run([sys.executable, "-c", code], record, dict(os.environ)) == 0
    told = "\n".join(trap.attempts(record))
    for tried in ("192.0.2.1:81", "192.0.2.2:82", "tried.invalid"):
        assert tried in told
    assert ":9\n" not in f"{told}\n"
