"""Lists every message of the program in tests/messages.txt, where it can be read as a whole.

python -m tests.docs.messages            writes the list anew

`test_messages.py` compares the list with the code, so wording is checked there and nowhere else:
other tests check exit codes and error classes. After a merge conflict in the list, write it anew.

Messages are read from the source text: first arguments and hints of errors, lines of progress and
log, warnings, help texts, findings. `{…}` stands for what a complex expression fills in.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = ROOT / "tests" / "messages.txt"

# Functions whose first argument is shown to a user.
_SHOWN = {"say", "warn", "warning", "fail", "complain", "show", "echo", "info", "print", "task"}
# Arguments and variables that hold a message, and how the list calls them.
_NAMED = {
    "hint": "hint",
    "help": "help",
    "description": "help",
    "fix": "hint",
    "about": "help",
    "limit": "help",
    "again": "help",
    "json": "help",
    "advice": "hint",
    "why": "text",
    "what": "text",
    "message": "text",
    "text": "text",
    "note": "text",
    "reason": "text",
}


def text_of(node: ast.expr | None) -> str:
    """The text of an expression, or "" if it is none."""
    if isinstance(node, ast.Constant):
        return " ".join(node.value.split()) if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(
            f"{{{_name(part.value)}}}" if isinstance(part, ast.FormattedValue) else str(part.value)
            for part in node.values
        )
    if isinstance(node, ast.IfExp):
        return " | ".join(filter(None, (text_of(node.body), text_of(node.orelse))))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    return ""


def _name(node: ast.expr) -> str:
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else "…"


def _called(node: ast.Call) -> str:
    function = node.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def error_classes(trees: list[ast.Module]) -> set[str]:
    """Names of the classes below KbError."""
    bases = {
        node.name: {getattr(base, "id", "") for base in node.bases}
        for tree in trees
        for node in tree.body
        if isinstance(node, ast.ClassDef)
    }
    known = {"KbError"}
    while more := {name for name, of in bases.items() if of & known} - known:
        known |= more
    return known


def messages_of(tree: ast.Module, errors: set[str]) -> Iterator[tuple[str, str]]:
    """(kind, message) of a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            yield _NAMED.get(node.targets[0].id, ""), text_of(node.value)
        elif isinstance(node, ast.Call):
            called, first = _called(node), node.args[0] if node.args else None
            if called in errors:
                yield "error", text_of(first)
            elif called in _SHOWN:
                yield "shown", text_of(first)
            elif called in ("Finding", "group"):
                yield from (("text", text_of(argument)) for argument in node.args[-2:])
            for keyword in node.keywords:
                yield _NAMED.get(keyword.arg or "", ""), text_of(keyword.value)


def listing() -> str:
    """The list: messages by module, each once, sorted."""
    paths = sorted([*ROOT.glob("kb/**/*.py"), *ROOT.glob("pipelines/*.py")])
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    errors = error_classes([*trees.values()])
    blocks = []
    for path, tree in trees.items():
        found = {
            (kind, text)
            for kind, text in messages_of(tree, errors)
            if kind and " " in text.strip() and any(letter.isalpha() for letter in text)
        }
        if found:
            lines = [f"  {kind:6} {text.strip()}" for kind, text in sorted(found)]
            blocks.append("\n".join([str(path.relative_to(ROOT)), *lines]))
    return "\n\n".join(blocks) + "\n"


if __name__ == "__main__":
    LIST.write_text(listing(), encoding="utf-8")
