"""Recipes: Python files that say how artifacts are made, the shipped ones and a user's own alike.

A user's own is named in the profile (`[youtube] pipeline = "mine.py"`) and lies beside it. What it
does not define is taken from the shipped one, then from what all sources share
(`pipelines/source.py`). It is code, and a data root or a release may come
from a stranger: so it runs only from a profile that the user named, or where this machine has noted
its path and text, outside of every data root, when it copied it into one.
"""

import ast
import atexit
import contextlib
import hashlib
import re
import traceback
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from kb.core.config.profile import Profile
from kb.core.config.section import read_text
from kb.core.errors import SettingError
from kb.core.installation import folder, state_root
from kb.core.sources import SOURCES

_OWN: set[str] = set()  # paths of users' recipes that this process may have run


def shipped(name: str) -> Path:
    """The file of a recipe that came with Lorecrawl or with a source's package.

    Raises SettingError.
    """
    path = folder("pipelines") / f"{name}.py"
    if not path.is_file() and name in SOURCES:
        path = SOURCES[name].package / "pipeline.py"
    if not path.is_file():
        raise SettingError(f"there is no recipe {path}", hint="install Lorecrawl again")
    return path


def own(profile: Profile) -> dict[str, Path]:
    """The user's own recipes, by the names of those that they replace."""
    sections = {name: getattr(profile, name) for name in type(profile).model_fields}
    files = {name: getattr(section, "pipeline", None) for name, section in sections.items()}
    return {name: profile.resolve_file(file) for name, file in files.items() if file}


def digests(profile: Profile, name: str) -> dict[str, str]:
    """By the name of a file, as messages show it, a digest of what it does: of all that makes what
    the recipe `name` does. A file that can't be read has none; whoever runs it says why.
    """
    paths = {f"{(path := shipped(name)).parent.name}/{path.name}": path}
    if (mine := own(profile).get(name)) is not None:
        paths[str(mine.relative_to(profile.path.parent))] = mine
    texts = {}
    for shown, path in paths.items():
        with contextlib.suppress(OSError, UnicodeDecodeError):
            texts[shown] = read_text(path)
    return {shown: _digest(text) for shown, text in texts.items()}


@lru_cache(maxsize=64)
def _digest(text: str) -> str:
    """A digest of the code without comments, docstrings and layout, the same in every Python."""
    with contextlib.suppress(SyntaxError, ValueError, RecursionError):  # which running it says
        text = _plain(ast.parse(text))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _plain(node: object) -> str:
    if isinstance(node, list):
        return f"[{','.join(map(_plain, node))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = {name: value for name, value in ast.iter_fields(node) if value not in (None, [])}
    if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
        fields["body"] = node.body[1:] if ast.get_docstring(node, clean=False) else node.body
    return f"{type(node).__name__}({','.join(f'{name}={_plain(fields[name])}' for name in fields)})"


def own_text(profile: Profile, path: Path) -> str:
    """The text of a user's own recipe. Raises SettingError where it can't be read, or may be a
    stranger's.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise SettingError(
            f"the recipe {path} can't be read: {why}",
            hint=f"{profile.path} names it as a `pipeline`",
        ) from None
    if not (profile.is_named or _is_remembered(path, text)):
        raise SettingError(
            f"the recipe {path} is code, which only runs where you name its profile",
            hint=f"read it; if you trust it, give --profile {profile.path}",
        )
    _OWN.add(str(path))
    return text


def own_place(error: BaseException) -> str:
    """The line of a user's own recipe from which an error came, also in a worker process; "" for an
    error from elsewhere.
    """
    lines = re.findall(r'File "(.+)", line (\d+)', "".join(traceback.format_exception(error)))
    own_lines = [f"{path}, line {line}" for path, line in lines if path in _OWN]
    return own_lines[-1] if own_lines else ""


def remember(path: Path, text: str) -> None:
    """Note that a recipe may run from this path as long as it has this text. Where the user's
    folder can't be written, nothing is noted.
    """
    with contextlib.suppress(OSError, RuntimeError):
        note = _note(path, text)
        note.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(f"{path}\n", encoding="utf-8")


def _is_remembered(path: Path, text: str) -> bool:
    try:
        return _note(path, text).is_file()
    except (OSError, RuntimeError):  # without a home
        return False


def _note(path: Path, text: str) -> Path:
    known = hashlib.sha256(f"{path.resolve()}\0{text}".encode()).hexdigest()
    return state_root() / "recipes" / known


class Recipe(NamedTuple):
    """A recipe that may run, also on another machine: `name` is that of the shipped one, `path` and
    `text` are those of a user's own in its place.
    """

    name: str
    path: str = ""
    text: str = ""

    def defined(self, name: str, *default: Any) -> Any:
        """What it defines under that name. Raises SettingError without any, or a `default`."""
        for module in self._modules():
            if hasattr(module, name):
                return getattr(module, name)
        if default:
            return default[0]
        raise SettingError(f"the recipe {shipped(self.name)} does not define `{name}`")

    def _modules(self) -> Iterator[ModuleType]:
        if self.text:
            yield _module(self.path, self.text)
        paths = [shipped(self.name), *([shipped("source")] if self.name in SOURCES else [])]
        for path in paths:
            yield _module(str(path), path.read_text(encoding="utf-8"))


def recipe_of(profile: Profile, name: str) -> Recipe:
    """The recipe of that name: the user's own where the profile names one. Raises SettingError."""
    mine = own(profile).get(name)
    return Recipe(name) if mine is None else Recipe(name, str(mine), own_text(profile, mine))


@lru_cache(maxsize=32)  # by its text: a process may outlive an edit
def _module(path: str, text: str) -> ModuleType:
    module = ModuleType("kb_pipeline_" + Path(path).stem)
    module.__file__ = path
    try:
        exec(compile(text, path, "exec"), module.__dict__)
    except (SyntaxError, ImportError) as error:
        raise SettingError(f"the recipe {path} can't be loaded: {error}") from error
    except (Exception, SystemExit) as error:
        what = f"{type(error).__name__}: {error}"
        raise SettingError(f"the recipe {path} can't be loaded: {what}") from error
    return module


# A module outside of sys.modules is not cleared when the interpreter ends, and DuckDB complains on
# stderr about all that it still holds then.
atexit.register(_module.cache_clear)
