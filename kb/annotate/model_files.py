"""The configuration and the tokenizer beside a checkpoint: whether they can be read.

Looked at before anything is sent or written; whether they go together and with the weights shows
when the model is loaded.
"""

import json
from pathlib import Path
from typing import Any

from kb.core.errors import MissingModel

_VOCABULARIES = (
    "vocab.txt",
    "tokenizer.json",
    "vocab.json",
    "spiece.model",
    "sentencepiece.bpe.model",
)
_OPTIONS = ("merges.txt", "tokenizer_config.json", "special_tokens_map.json", "added_tokens.json")


def tokenizer_files(folder: Path) -> list[Path]:
    """The files of a tokenizer in a model's folder; none when there is no vocabulary among them."""
    if not any((folder / name).is_file() for name in _VOCABULARIES):
        return []
    return [folder / name for name in (*_VOCABULARIES, *_OPTIONS) if (folder / name).is_file()]


def check_model_files(folder: Path, what_to_do: str) -> None:
    """Raise MissingModel when configuration or tokenizer are missing or can't be read."""
    if not (folder / "config.json").is_file():
        raise MissingModel(f"there is no config.json in {folder}", hint=what_to_do)
    files = tokenizer_files(folder)
    if not files:
        raise MissingModel(f"there is no tokenizer in {folder}", hint=what_to_do)
    problem = next(
        (problem for path in (folder / "config.json", *files) if (problem := problem_of(path))), ""
    )
    if problem:
        raise MissingModel(f"{folder}: {problem}", hint=what_to_do)


def problem_of(path: Path, name: str = "") -> str:
    """What is wrong with a file that is to be `name`, in words; "" when nothing is.

    Binary ones are only looked at.
    """
    name = name or path.name
    try:
        if name.endswith(".json"):
            content = _object(path)
            if name == "tokenizer.json" and not isinstance(content.get("model"), dict):
                return "tokenizer.json is no tokenizer"
            return (
                f"{name} is empty" if not content and name in ("config.json", "vocab.json") else ""
            )
        if name.endswith(".txt"):
            return _problem_of_words(path, name)
        head = path.read_bytes()[:64].lstrip().lower() if path.is_file() else b""
    except UnicodeDecodeError:
        return f"{name} is no UTF-8 text"
    except (ValueError, RecursionError):
        return f"{name} is no JSON object"
    except OSError as error:
        return f"{name} can't be read: {error.strerror}"
    return (
        f"{name} is empty or a web page"
        if not head or head.startswith((b"<!doctype", b"<html"))
        else ""
    )


def _problem_of_words(path: Path, name: str) -> str:
    lines = path.read_text(encoding="utf-8").rstrip("\n").split("\n")
    if lines[0].lstrip().lower().startswith(("<!doctype", "<html")):
        return f"{name} is a web page"
    if name == "vocab.txt" and "[UNK]" not in (line.strip() for line in lines):
        return "vocab.txt has no token [UNK]"
    if name == "merges.txt" and not any(
        len(line.split()) == 2 for line in lines if not line.startswith("#version")
    ):
        return "merges.txt has no pair of tokens"
    return ""


def _object(path: Path) -> dict[str, Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError(path.name)  # noqa: TRY004  as for what is no JSON
    return content
