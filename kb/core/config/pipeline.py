"""Pipelines are Python files, shipped ones and a user's own alike.

What travels to workers is a shipped one's name, and the text of a user's own.
"""

import atexit
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from kb.core.errors import SettingError
from kb.core.installation import folder
from kb.core.sources import SOURCES


def locate(name: str, override: str | None = None) -> Path:
    """The file of a pipeline: `--pipeline FILE`, the shipped one or that of the source's package.

    Raises SettingError.
    """
    path = Path(override) if override else folder("pipelines") / f"{name}.py"
    if not override and not path.is_file() and name in SOURCES:
        path = SOURCES[name].folder / "pipeline.py"
    if not path.is_file():
        raise SettingError(
            f"there is no pipeline file {path}", hint="give --pipeline a Python file that exists"
        )
    return path.resolve()


def load(path: str) -> ModuleType:
    """The module in that file, as it is now. Raises SettingError."""
    try:
        return _module(path, Path(path).read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise SettingError(f"the pipeline {path} can't be loaded: {error}") from None


def packed(name: str, override: str | None = None) -> tuple[str, str]:
    """What `unpack` makes the same pipeline of elsewhere: (name, ""), or (path, text)."""
    path = locate(name, override)
    return (str(path), path.read_text(encoding="utf-8")) if override else (name, "")


def unpack(name: str, text: str) -> ModuleType:
    """The pipeline that was packed. Raises SettingError."""
    return _module(name, text) if text else load(str(locate(name)))


@lru_cache(maxsize=32)  # by its text: a process may outlive an edit
def _module(path: str, text: str) -> ModuleType:
    module = ModuleType("kb_pipeline_" + Path(path).stem)
    module.__file__ = path
    try:
        exec(compile(text, path, "exec"), module.__dict__)
    except (SyntaxError, ImportError) as error:
        raise SettingError(f"the pipeline {path} can't be loaded: {error}") from error
    return module


# A module outside of sys.modules is not cleared when the interpreter ends, and DuckDB complains on
# stderr about all that it still holds then.
atexit.register(_module.cache_clear)
