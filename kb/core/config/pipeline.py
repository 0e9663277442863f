"""Pipelines are files loaded by path, shipped ones and a user's own alike."""

import importlib.util
from functools import cache
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


@cache
def load(path: str) -> ModuleType:
    """The module in that file. Workers call it with the same path, so nothing of it is pickled."""
    name = "kb_pipeline_" + Path(path).stem
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise SettingError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (SyntaxError, ImportError) as error:
        raise SettingError(f"the pipeline {path} can't be loaded: {error}") from error
    return module
