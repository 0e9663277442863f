"""Options that each command takes and refuses; signals while one runs."""

import json
import logging
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kb.cli import main
from kb.cli.app import context, leaves
from kb.cli.framework.command import configure_logs
from kb.cli.framework.exit_codes import report
from kb.cli.framework.messages import show_summary
from kb.cli.framework.options import COMMON, DESCRIBED, RUNNING, SHARED
from kb.core.errors import FatalError
from kb.core.progress import LineProgress
from tests import processes
from tests.cli.conftest import clean_environment
from tests.core.test_terminal import HOSTILE

COMMANDS = dict(leaves())


@pytest.mark.parametrize("option", DESCRIBED)
def test_what_differs_by_command_is_described_for_each(option: str) -> None:
    """Not one sentence for all: what --limit counts, what --again reads, what --json holds."""
    helps = {
        name: parameter.help
        for name, command in COMMANDS.items()
        for parameter in command.params
        if parameter.name == option
    }
    assert len(helps) >= 10
    assert all(helps.values()), [name for name, text in helps.items() if not text]
    assert len(set(helps.values())) > len(helps) / 2


CLUSTER = {"workers", "engine", "scheduler"}


SOURCES = ("youtube", "wiki", "reddit")


# What has an effect on each command, besides the common options; all else is refused.
APPLIES = {
    "youtube crawl": {"workers", "limit", "wait", "again"},
    "youtube import": {"limit"},
    "wiki crawl": {"workers", "limit", "wait", "again"},
    "reddit crawl": {"limit", "wait", "again"},
    "reddit import": {*CLUSTER, "limit", "again"},
    "reddit reconstruct": {"workers", "limit", "wait", "again"},
    **{f"{source} filter": {*CLUSTER, "limit"} for source in SOURCES},
    **{f"annotate {source}": {*CLUSTER, "limit"} for source in SOURCES},
    **{f"{source} export": {"engine", "scheduler"} for source in SOURCES},
    **{f"purge {source}": CLUSTER for source in SOURCES},
    "pairs": {*CLUSTER, "again"},
    "pairs measure": {"wait"},
    "pairs score": CLUSTER,
    "clips": CLUSTER,
    "label export": set(),
    "tasks": {"again"},
    "label import": set(),
    "links": {*CLUSTER, "again"},
    "release publish": {"wait"},
    "report": {"workers"},
    "index": {"again"},
    "search": {"limit"},
    "query": {"limit"},
    "restore": {"workers", "limit", "wait", "again"},
    "refresh youtube": {"limit", "wait"},
    "refresh reddit": {*CLUSTER, "limit", "wait", "again"},
    "demo": CLUSTER,
    "doctor": {"engine", "scheduler"},
    "build": CLUSTER,
    "update": {*CLUSTER, "wait"},
    "diff": {"limit"},
}


WITHOUT = {
    "diff": {"data", "profile"},
    "models fetch": {"data"},
    "profile new": {"data", "profile"},
    "sandbox": {"json"},
    "mcp": {"json"},
    "explore": {"json"},
}


VALUES = {"workers": "2", "limit": "3", "engine": "local", "scheduler": "tcp://127.0.0.1:1"} | {
    "data": "here",
    "profile": "minecraft",
}


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_command_takes_what_has_an_effect_on_it_and_refuses_the_rest(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = (set(COMMON) - WITHOUT.get(name, set())) | APPLIES.get(name, set())
    options = {parameter.name for parameter in COMMANDS[name].params}
    assert options & set(SHARED) == wanted
    for option in sorted(set(SHARED) - wanted):
        given = [f"--{option}", *([VALUES[option]] if option in VALUES else [])]
        with pytest.raises(SystemExit) as ended:
            main([*name.split(), *given])
        assert ended.value.code == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert f"`kb {name}` has no --{option}; it is an option of `kb " in line
        for other in re.findall(r"option of (.*?);", line)[0].split(" and "):
            for path in re.findall(r"`kb ([a-z ]+)`", other):
                assert option in {parameter.name for parameter in COMMANDS[path].params}
    assert list(tmp_path.iterdir()) == []


def test_an_option_before_a_groups_command_is_not_dropped(kb: Any) -> None:
    answer = kb("pairs", "--data", "elsewhere", "keywords")
    assert answer.returncode == 2
    assert "`kb pairs keywords --data …`" in answer.stderr


# Two commands of the usual make: one that looks at the stop flag between items, one that is blocked
# in a wait. A shell without job control starts background jobs, this suite perhaps, with SIGINT
# ignored, and children inherit that.
PROGRAM = """
import signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)
from kb.cli.framework.exit_codes import run_to_exit_code
from kb.cli.framework.command import command, group
from kb.core import clock, signals
from kb.core.summary import Summary

app = group("Test.")

def block():
    while True:  # a signal between the call and the wait in it would be seen when the wait ends
        threading.Event().wait(0.05)

@command(app, data="ignores", examples=["x"])
def crawl(run):
    '''Crawl.'''
    done = 0
    try:
        while True:
            signals.stop.raise_if_asked()
            done += 1
            if done == 1:
                print("ready", flush=True)
            clock.sleep(0.01)
    except signals.Interrupted as stopped:
        stopped.summary = Summary(crawled=done > 0)
        raise

@command(app, data="ignores", examples=["x"])
def deaf(run):
    '''An item that takes for ever.'''
    print("ready", flush=True)
    while not signals.stop.wait(0.05):
        pass
    print("asked", flush=True)
    block()

@command(app, data="ignores", examples=["x"], resumable=False)
def query(run):
    '''Blocked in something that knows no flag.'''
    print("ready", flush=True)
    block()

sys.exit(run_to_exit_code(app))
"""


def start(folder: Path, *arguments: str) -> processes.ForkedProcess:
    process = processes.program(PROGRAM, *arguments, env=clean_environment(), cwd=folder)
    assert process.lines(1) == ["ready"]
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
    assert out == f"ready\n1 crawled, stopped by {number.name}\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_query_ends_at_once(tmp_path: Path, number: signal.Signals) -> None:
    process = start(tmp_path, "query")
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (3, "ready\n")
    assert err.count("\n") == 1


def test_a_second_ctrl_c_does_not_wait_for_the_item(tmp_path: Path) -> None:
    process = start(tmp_path, "deaf")
    process.send_signal(signal.SIGINT)
    assert process.lines(2) == ["ready", "asked"]
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
        env={**clean_environment(), "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[3]}"},
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
    assert json.loads(out) == {
        "stopped": f"stopped by {number.name}",
        "waits_for": "next run",
    }


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_and_option_is_described(name: str) -> None:
    command = COMMANDS[name]
    assert command.help, "no help text"
    assert command.help.splitlines()[0].endswith("."), "the first line is a sentence"
    assert command.epilog, "no example"
    for example in command.epilog.splitlines():
        assert example.startswith(f"kb {name}") or name in example, (
            f"not an example of kb {name}: {example}"
        )
    for parameter in command.params:
        if parameter.name not in ("help", "context"):
            assert getattr(parameter, "help", None), f"{parameter.name} has no help"
    shown = command.get_help(context(name, command))
    for parameter in command.params:
        for option in parameter.opts:
            if parameter.param_type_name == "option":
                assert option in shown, f"{option} is not in --help"
    assert "Examples:" in shown


@pytest.mark.parametrize(
    ("name", "running"),
    [("youtube crawl", {"workers", "limit", "wait", "again"}), ("status", set())],
)
def test_help_has_its_options_in_groups(name: str, running: set[str]) -> None:
    command = COMMANDS[name]
    shown = command.get_help(context(name, command))
    sections = re.split(r"^(?=\S.*:\n)", shown, flags=re.MULTILINE)
    by_title = {part.split(":\n")[0]: part for part in sections}
    assert all(f"--{option}" in by_title["Common options"] for option in COMMON)
    assert ("Run options" in by_title) == bool(running)
    for option in RUNNING:
        assert (f"--{option} " in by_title.get("Run options", "")) == (option in running), option


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_examples_name_options_that_exist(name: str) -> None:
    command = COMMANDS[name]
    known = {option for parameter in command.params for option in parameter.opts}
    for example in command.epilog.splitlines():
        before_comment = re.split(r"  +", example)[0].split(" -- ")[0]
        if before_comment.removeprefix(f"kb {name} ").split(" ")[0] in getattr(
            command, "commands", {}
        ):
            continue  # an example of one of the group's commands
        for option in re.findall(r"(?<=\s)--[a-z-]+", before_comment):
            assert option in known, f"{option} in: {example}"


def test_nothing_on_stderr_or_stdout_acts(capsys: pytest.CaptureFixture[str]) -> None:
    handlers = logging.getLogger().handlers[:]
    try:
        configure_logs(debug=False)
        logging.getLogger("praw").warning("said %s", HOSTILE)
        report(FatalError(f"refused: {HOSTILE}"), debug=True, as_json=False)
        show_summary({"why": HOSTILE}, False)
        show_summary({"why": HOSTILE.replace("\ud800", "")}, True)
        LineProgress(sys.stderr).say(HOSTILE)
    finally:
        logging.getLogger().handlers[:] = handlers
    done = capsys.readouterr()
    for stream in (done.out, done.err):
        assert not set("\x1b\x07\x9b\u202e\r\u2028\ud800") & set(stream)
        assert r"\x1b]0;t\x07" in stream
    lines = done.err.splitlines()
    assert [line for line in lines if line.startswith("kb: ")] == [lines[-2]]


def test_a_repeated_line_says_once_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    """Of servers' libraries too, whose lines a port scanner can repeat without end."""
    handlers = logging.getLogger().handlers[:]
    try:
        configure_logs(debug=False)
        for _ in range(4):
            logging.getLogger("uvicorn.error").warning("Invalid HTTP request received.")
            logging.getLogger("mcp.server").warning("Failed to validate request")
        logging.getLogger("kb.youtube").warning("another")
    finally:
        logging.getLogger().handlers[:] = handlers
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 5
    assert "the pages go on" in lines[0]
    assert "kb mcp --debug" in lines[1]
    assert all("--log FILE" in line for line in lines[2:4])
    assert lines[4] == "warning: kb.youtube: another"
