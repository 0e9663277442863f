"""SIGINT and SIGTERM end a command with exit code 3 and one line, whatever it is doing."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import clean_environment

# Two commands of the usual make: one that looks at the stop flag between items, one that is blocked
# in a wait. A shell without job control starts background jobs, this suite perhaps, with SIGINT
# ignored, and children inherit that.
PROGRAM = """
import signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)
from kb.cli.framework.exit_codes import run_to_exit_code
from kb.cli.framework.command import command, group
from kb.core import clock, signals
from kb.core.verdict import Summary

app = group("Test.")

def block():
    while True:  # a signal between the call and the wait in it would be seen when the wait ends
        threading.Event().wait(0.05)

@command(app, examples=["x"])
def crawl(run):
    '''Crawl.'''
    done = 0
    try:
        while True:
            signals.stop.check()
            done += 1
            if done == 1:
                print("ready", flush=True)
            clock.sleep(0.01)
    except signals.Interrupted as stopped:
        stopped.summary = Summary(crawled=done > 0)
        raise

@command(app, examples=["x"])
def deaf(run):
    '''An item that takes for ever.'''
    print("ready", flush=True)
    while not signals.stop.wait(0.05):
        pass
    print("asked", flush=True)
    block()

@command(app, examples=["x"], resumable=False)
def query(run):
    '''Blocked in something that knows no flag.'''
    print("ready", flush=True)
    block()

sys.exit(run_to_exit_code(lambda: app(prog_name="x", standalone_mode=False)))
"""


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = {**clean_environment(), "PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_crawl_finishes_the_item_in_hand_and_says_how_to_go_on(
    tmp_path: Path, number: signal.Signals
) -> None:
    process = start(tmp_path, "crawl")
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert err == f"kb: stopped by {number.name}; run the same command to resume\n"
    assert out == f"1 crawled, stopped by {number.name}\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_query_ends_at_once(tmp_path: Path, number: signal.Signals) -> None:
    process = start(tmp_path, "query")
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (3, "")
    assert err.count("\n") == 1


def test_a_second_ctrl_c_does_not_wait_for_the_item(tmp_path: Path) -> None:
    process = start(tmp_path, "deaf")
    process.send_signal(signal.SIGINT)
    assert process.stdout is not None
    assert process.stdout.readline() == "asked\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "Traceback" not in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_command_is_still_being_loaded(
    tmp_path: Path, number: signal.Signals
) -> None:
    """Whatever is imported when it comes: here the command tree, which says so and waits."""
    (tmp_path / "typer.py").write_text(
        'import time\nprint("importing", flush=True)\nwhile True:\n    time.sleep(0.05)\n'
    )
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
        " from kb.cli import main; main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program, "youtube", "crawl", "--json"],
        cwd=tmp_path,
        env={**clean_environment(), "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}"},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "importing\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert err == f"kb: stopped by {number.name}; run the same command to resume\n"
    assert json.loads(out) == {"stopped": f"stopped by {number.name}"}
