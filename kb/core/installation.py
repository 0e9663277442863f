"""The installed software: its version, the files that travel with it, its extras and its cache.

No package index has Lorecrawl, so no text names a package that anybody else could register there.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.core.errors import DamagedData, MissingExtra

_LABELS = ("source", "repository", "github", "homepage")  # of a package's addresses, best first


def install_extra(extra: str = "", *, here: bool = True) -> str:
    """How to install an optional part of the software, or with "" the software itself; `here`: as
    it was set up on this machine.
    """
    package = f'".[{extra}]"' if extra else "."
    light = " LIGHT=0" if here and Path(sys.prefix, ".light").exists() else ""
    return (
        f"run `make setup{light}` in the checkout of Lorecrawl, or `pip install -e {package}` there"
    )


@cache
def lock_digest() -> str:
    """SHA-256 of the exact versions that Lorecrawl is tested with; empty where the installation
    has none.
    """
    package = Path(__file__).resolve().parent.parent
    for path in (package / "requirements.lock", package.parent / ".ci" / "requirements.lock"):
        if path.is_file():
            return hashlib.sha256(path.read_bytes()).hexdigest()
    return ""


@cache  # of the code that this process runs, whatever is installed meanwhile
def code_digest() -> str:
    """SHA-256 of the installed code with its schemas and pipelines, the same for a checkout."""
    package = Path(__file__).resolve().parent.parent
    roots = {"kb": package, "schemas": folder("schemas"), "pipelines": folder("pipelines")}
    files = {
        f"{name}/{path.relative_to(root).as_posix()}": path
        for name, root in roots.items()
        for path in root.rglob("*")
        if path.is_file() and path.suffix not in (".pyc", ".md", ".lock")
    }
    for name in _CHECKOUT:  # of a wheel, where they are inside of the package
        files = {key: path for key, path in files.items() if not key.startswith(f"kb/{name}/")}
    digest = hashlib.sha256()
    for key in sorted(files):
        digest.update(f"{key}\0{hashlib.sha256(files[key].read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


@cache
def software_address() -> str | None:
    """Where the software is published; None where its package does not say (`[project.urls]`).

    The labels are those of https://packaging.python.org/specifications/well-known-project-urls/,
    the place of the code first.
    """
    try:
        declared = importlib.metadata.metadata("lorecrawl").get_all("Project-URL") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    urls: dict[str, str] = {}
    for line in declared:
        label, _, url = line.partition(",")
        urls[label.strip().lower()] = url.strip()
    return next((urls[label] for label in _LABELS if urls.get(label)), None)


PROFILE_FILE = "profile.toml"  # its name in a folder of its own, and in a release folder
_CHECKOUT = {"schemas": "schemas", "pipelines": "pipelines", "profiles": "data/profiles"}


@cache
def folder(name: str) -> Path:
    """The folder "schemas", "pipelines" or "profiles". Raises DamagedData when it is gone."""
    package = Path(__file__).resolve().parent.parent
    for candidate in (package / name, package.parent / _CHECKOUT[name]):
        if candidate.is_dir():
            return candidate
    raise DamagedData(
        f"the folder {name!r} of Lorecrawl is missing", hint="install Lorecrawl again"
    )


__all__ = [
    "ds",
    "fsspec",
    "fsspec_cached",
    "googleapiclient",
    "httplib2",
    "langcodes",
    "np",
    "pc",
    "require",
    "tenacity",
    "torch",
]


class _LatePackage:
    """Imports the package when an attribute is asked for; not for whoever only looks at it."""

    def __init__(self, name: str, extra: str) -> None:
        self._name, self._extra = name, extra

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("_"):
            raise AttributeError(attribute)
        require(self._extra, self._name)
        package = import_module(self._name)
        if not hasattr(package, attribute):
            with contextlib.suppress(ModuleNotFoundError):  # else it may be a module of the package
                import_module(f"{self._name}.{attribute}")
        value = getattr(package, attribute)
        setattr(self, attribute, value)
        return value


def require(extra: str, *packages: str) -> None:
    """Raises MissingExtra unless these packages, which `extra` installs, can be imported."""
    for package in packages:
        if find_spec(package) is None:
            raise MissingExtra(
                f"the package {package.replace('_', '-')} is not installed",
                hint=install_extra(extra),
            )


if TYPE_CHECKING:
    import fsspec
    import fsspec.implementations.cached as fsspec_cached
    import googleapiclient.discovery
    import googleapiclient.errors
    import httplib2
    import langcodes.registry_parser
    import numpy as np
    import pyarrow.compute as pc
    import pyarrow.dataset as ds
    import tenacity
    import torch
else:
    ds = _LatePackage("pyarrow.dataset", "")  # which imports pandas where that is installed
    fsspec = _LatePackage("fsspec", "")
    fsspec_cached = _LatePackage("fsspec.implementations.cached", "")
    googleapiclient = _LatePackage("googleapiclient", "")
    httplib2 = _LatePackage("httplib2", "")
    langcodes = _LatePackage("langcodes", "")
    np = _LatePackage("numpy", "")
    pc = _LatePackage("pyarrow.compute", "")  # 0.06 s of what every command would take to start
    tenacity = _LatePackage("tenacity", "")  # with asyncio, and Tornado where that is installed
    torch = _LatePackage("torch", "torch")


def cache_root() -> Path:
    """Where models and what is made of them are kept for every data root of this user."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base).absolute() / "lorecrawl"


def state_root() -> Path:
    """Where this user's Lorecrawl notes what no data root may say. Raises RuntimeError without a
    home.
    """
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base).absolute() / "lorecrawl"


@contextlib.contextmanager
def making(folder: Path, is_complete: Callable[[], bool]) -> Iterator[Path]:
    """A fresh folder that becomes `folder` when the block ends well.

    Several processes may make the same one at once (workers of a cluster): the first one's stays,
    if `is_complete` says so. Raises OSError when the cache can't be written.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    fresh.chmod(0o755)
    try:
        yield fresh
        try:
            os.rename(fresh, folder)
        except OSError:
            if not is_complete():
                shutil.rmtree(folder, ignore_errors=True)
                os.rename(fresh, folder)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
