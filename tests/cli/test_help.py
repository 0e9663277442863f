"""Help: quick, complete, with an example for every command."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from kb.cli import main
from kb.cli.app import TREE, context, leaves
from kb.cli.framework.options import COMMON, DESCRIBED, RUNNING, SHARED

# What may be imported before a command runs: a budget in modules, as a time would depend on the
# machine.
NOT_FOR_HELP = (
    "rich",
    "pydantic",
    "pydantic_settings",
    "structlog",
    "pyarrow",
    "duckdb",
    "numpy",
    "requests",
    "googleapiclient",
    "praw",
    "selenium",
    "torch",
    "dask",
    "distributed",
    "matplotlib",
    "PIL",
    "transformers",
    "detoxify",
    "zstandard",
    "orjson",
    "msgspec",
    "werkzeug",
)


COMMANDS = dict(leaves())


def imports_of(code: str) -> set[str]:
    answer = subprocess.run(
        [
            sys.executable,
            "-c",
            (
                f"import json, sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\n"
                "print('\\n' + json.dumps(sorted(sys.modules)))"
            ),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(json.loads(answer.stdout.splitlines()[-1]))


def test_help_imports_nothing_heavy() -> None:
    loaded = imports_of("from kb.cli import main; main(['--help'])")
    assert "typer" in loaded
    assert not loaded & set(NOT_FOR_HELP)
    specs = {name for source in SOURCES for name in (f"kb.{source}", f"kb.{source}.spec")}
    assert len([name for name in loaded - specs if name.startswith("kb.")]) <= 15
    assert len(loaded) < 400


# Each command's help in a fork of a process that has loaded what every command loads.
FORKS = """
import json, os, sys
import kb.cli.app
from kb.cli import main
for name in json.loads(sys.argv[1]):
    if os.fork() == 0:
        try:
            main([*name.split(), "--help"])
        except SystemExit:
            pass
        print("\\n" + json.dumps({name: sorted(sys.modules)}), flush=True)
        os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def loaded_by() -> dict[str, set[str]]:
    """What is loaded once a command has shown its help, by command."""
    answer = subprocess.run(
        [sys.executable, "-c", FORKS, json.dumps(sorted(COMMANDS))],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [json.loads(line) for line in answer.stdout.splitlines() if line.startswith('{"')]
    return {name: set(loaded) for line in lines for name, loaded in line.items()}


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_commands_help_imports_nothing_heavy(name: str, loaded_by: dict[str, set[str]]) -> None:
    loaded = loaded_by[name]
    assert "typer" in loaded
    # typer checks the types of a command's options with pydantic; that's typer's own need.
    assert not loaded & (set(NOT_FOR_HELP) - {"pydantic"})


def test_help_lists_every_group(kb: Any) -> None:
    answer = kb("--help")
    assert answer.returncode == 0
    assert answer.stderr == ""
    for name, (_, line) in TREE.items():
        assert re.search(rf"^  {name} +{re.escape(line)}$", answer.stdout, re.MULTILINE), name


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


@pytest.mark.parametrize("words", ["", "youtube", "youtube crawl", "pairs", "query"])
def test_every_way_to_ask_for_help_shows_the_same(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def shown(*arguments: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main([*arguments])
        assert ended.value.code == 0
        return capsys.readouterr().out

    text = shown(*words.split(), "--help")
    assert text.startswith(f"Usage: kb {words}".rstrip())
    assert shown(*words.split(), "-h") == text
    assert shown("help", *words.split()) == text


COMPLETED = """
eval "$(kb --show-completion)"
complete_after() {
    COMP_WORDS=(kb "$@"); COMP_CWORD=$#; COMPREPLY=()
    _kb_completion kb
    echo "${COMPREPLY[@]}"
}
complete_after you
complete_after youtube cra
complete_after youtube crawl --only meta
"""


def test_bash_completes_commands_options_and_values(tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", COMPLETED],
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["youtube", "crawl", "metadata"]


CLUSTER = {"workers", "engine", "scheduler"}
SOURCES = ("youtube", "wiki", "reddit")
# What has an effect on each command, besides the common options; all else is refused.
APPLIES = {
    "youtube crawl": {"workers", "limit", "wait", "again", "pipeline"},
    "youtube check": {"limit", "wait", "again"},
    "youtube import": {"limit"},
    "wiki crawl": {"workers", "limit", "wait", "again", "pipeline"},
    "reddit crawl": {"limit", "wait", "again"},
    "reddit import": {*CLUSTER, "limit", "again"},
    "reddit reconstruct": {"workers", "limit", "wait", "again"},
    **{f"{source} filter": {*CLUSTER, "limit", "pipeline"} for source in SOURCES},
    **{f"annotate {source}": {*CLUSTER, "limit", "pipeline"} for source in SOURCES},
    **{f"{source} export": {"engine", "scheduler", "pipeline"} for source in SOURCES},
    **{f"purge {source}": CLUSTER for source in SOURCES},
    "pairs": {*CLUSTER, "limit", "again", "pipeline"},
    "links": {*CLUSTER, "again", "pipeline"},
    "release": {"pipeline"},
    "release publish": {"wait", "pipeline"},
    "report": {"workers"},
    "index": {"again"},
    "search": {"limit"},
    "query": {"limit"},
    "restore": {"workers", "limit", "wait", "again"},
    "refresh youtube": {"limit", "wait"},
    "refresh reddit": {*CLUSTER, "limit", "wait", "again"},
    "demo": CLUSTER,
}
WITHOUT = {
    "models fetch": {"data", "profile"},
    "profile new": {"data", "profile"},
    "sandbox": {"json"},
    "mcp": {"json"},
}
VALUES = {"workers": "2", "limit": "3", "engine": "local", "scheduler": "tcp://127.0.0.1:1"} | {
    "pipeline": "mine.py",
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


def test_an_option_of_a_sibling_is_looked_for_there_first(kb: Any) -> None:
    answer = kb("youtube", "export", "--limit", "3", "--wait", "--again")
    assert answer.returncode == 2
    assert "`kb youtube export` has no --limit" in answer.stderr
    assert "of `kb youtube crawl`, `kb youtube check`, `kb youtube import` and" in answer.stderr
    answer = kb("youtube", "crawl", "--titles", "x")
    assert "`kb youtube crawl` has no --titles; it is an option of `kb wiki crawl`" in answer.stderr


def test_an_option_before_a_groups_command_is_not_dropped(kb: Any) -> None:
    answer = kb("pairs", "--data", "elsewhere", "keywords")
    assert answer.returncode == 2
    assert "`kb pairs keywords --data …`" in answer.stderr


@pytest.mark.parametrize("name", ["youtube crawl", "status"])
def test_help_has_its_options_in_groups(name: str) -> None:
    command = COMMANDS[name]
    shown = command.get_help(context(name, command))
    sections = re.split(r"^(?=\S.*:\n)", shown, flags=re.MULTILINE)
    by_title = {part.split(":\n")[0]: part for part in sections}
    assert all(f"--{option}" in by_title["Common options"] for option in COMMON)
    running = APPLIES.get(name, set())
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
