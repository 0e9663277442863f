"""Packages of optional extras, imported at their first use, so that commands run without them."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from kb.core.errors import MissingExtra
from kb.core.installation import install_extra

__all__ = ["np", "require"]


class _OptionalPackage:
    """Imports the package when an attribute is asked for."""

    def __init__(self, name: str, extra: str) -> None:
        self._name, self._extra = name, extra

    def __getattr__(self, attribute: str) -> Any:
        require(self._extra, self._name)
        value = getattr(import_module(self._name), attribute)
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
    import numpy as np
else:
    np = _OptionalPackage("numpy", "pairs")
