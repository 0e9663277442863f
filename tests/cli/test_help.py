"""Help: quick, complete, with an example for every command."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer.main

from kb.cli.app import TREE, app
from kb.cli.options import COMMON

# What may be imported before a command runs: a budget in modules, as a time would depend on the machine.
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


def leaves() -> Iterator[tuple[str, Any]]:
    """("youtube crawl", command) of every command that does something."""
    root = typer.main.get_command(app)
    context = typer.Context(root, info_name="kb")
    for name, (module, _) in TREE.items():
        if importlib.util.find_spec(module) is None:
            continue  # tests/test_arrows.py says so
        command = root.get_command(context, name)  # type: ignore[attr-defined]
        inner = getattr(command, "commands", {})
        if not inner or command.invoke_without_command:
            yield name, command
        for child, leaf in inner.items():
            yield f"{name} {child}", leaf


COMMANDS = dict(leaves())


def imports_of(code: str) -> set[str]:
    answer = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import json, sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\nprint('\\n' + json.dumps(sorted(sys.modules)))",
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
    assert len([name for name in loaded if name.startswith("kb.")]) <= 5
    assert len(loaded) < 400


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_commands_help_imports_nothing_heavy(name: str) -> None:
    loaded = imports_of(f"from kb.cli import main; main({[*name.split(), '--help']!r})")
    # typer checks the types of a command's options with pydantic; that's typer's own need.
    assert not loaded & (set(NOT_FOR_HELP) - {"pydantic"})


def test_help_lists_every_group(kb: Any) -> None:
    answer = kb("--help")
    assert answer.returncode == 0
    assert answer.stderr == ""
    for name, (_, line) in TREE.items():
        assert re.search(rf"^  {name} +{re.escape(line)}$", answer.stdout, re.M), name


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_and_option_is_described(name: str) -> None:
    command = COMMANDS[name]
    context = typer.Context(command, info_name=f"kb {name}")
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
    shown = command.get_help(context)
    for parameter in command.params:
        for option in parameter.opts:
            if parameter.param_type_name == "option":
                assert option in shown, f"{option} is not in --help"
    assert "Examples:" in shown


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_the_common_options(name: str) -> None:
    options = {parameter.name for parameter in COMMANDS[name].params}
    assert set(COMMON) <= options


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
