"""Asks the sandbox's services and compares the form of answers."""

from typing import Any

import requests

# The metadata of a deposit that is complete.
GOOD = {"title": "T", "upload_type": "dataset", "description": "D", "creators": [{"name": "N"}]}


def ask(root: str, **params: str) -> dict[str, Any]:
    """The wiki's answer to a query of its API."""
    return requests.get(f"{root}/w/api.php", {"action": "query", **params}, timeout=9).json()


def form(value: Any) -> Any:
    """Keys and types of a JSON value; of a list its first element's."""
    if isinstance(value, dict):
        return {name: form(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [form(value[0])] if value else []
    return type(value).__name__


def lacking(real: Any, made: Any, path: str = "") -> list[str]:
    """Where the sandbox's answer lacks a field of the recorded one, or has it in another type."""
    if isinstance(real, dict) and isinstance(made, dict):
        return [
            found
            for name in real
            for found in (
                [f"{path}.{name} is absent"]
                if name not in made
                else lacking(real[name], made[name], f"{path}.{name}")
            )
        ]
    if isinstance(real, list) and isinstance(made, list):
        return lacking(real[0], made[0], path + "[]") if real and made else []
    return [] if type(real) is type(made) else [f"{path}: {real!r} and {made!r}"]
