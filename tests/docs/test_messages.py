"""How tests/docs/messages.py finds the messages of the program."""

from __future__ import annotations

import ast

from tests.docs.messages import error_classes, messages_of

EXAMPLE = """
class Spent(Stopped): ...
class Stopped(KbError): ...

def f(run, name, path):
    fix = "set it"
    run.progress.say(f"{name} was removed")
    raise Spent(
        f"quota of {path.name} is " + ("spent" if name else "unknown"),
        hint=f"wait for {run.at(3)}",
    )
"""


def test_errors_hints_and_lines_are_found() -> None:
    tree = ast.parse(EXAMPLE)
    found = {pair for pair in messages_of(tree, error_classes([tree])) if all(pair)}
    assert found == {
        ("hint", "set it"),
        ("shown", "{name} was removed"),
        ("error", "quota of {name} is spent | unknown"),
        ("hint", "wait for {…}"),
    }
