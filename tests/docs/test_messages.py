"""tests/messages.txt lists the messages of the program as they are."""

import ast

from tests.docs.messages import LIST, error_classes, listing, messages_of

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


def test_the_list_is_up_to_date() -> None:
    ours, theirs = listing().splitlines(), LIST.read_text(encoding="utf-8").splitlines()
    changed = [f"+ {line}" for line in ours if line not in set(theirs)]
    changed += [f"- {line}" for line in theirs if line not in set(ours)]
    assert ours == theirs, "\n".join(
        ["tests/messages.txt is out of date: python -m tests.docs.messages", *changed[:20]]
    )


def test_errors_hints_and_lines_are_found() -> None:
    tree = ast.parse(EXAMPLE)
    found = {pair for pair in messages_of(tree, error_classes([tree])) if all(pair)}
    assert found == {
        ("hint", "set it"),
        ("shown", "{name} was removed"),
        ("error", "quota of {name} is spent | unknown"),
        ("hint", "wait for {…}"),
    }
