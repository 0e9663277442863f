"""Help texts: sections, descriptions, examples."""

import re

import pytest

from kb.cli.app import context, leaves
from kb.cli.framework.options import COMMON, RUNNING

COMMANDS = dict(leaves())


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
    [("youtube crawl", {"workers", "limit", "wait", "again", "pipeline"}), ("status", set())],
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
