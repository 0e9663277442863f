"""What this software is, where it comes from and how to install it, for messages and cards.

No package index has Lorecrawl, so no text names a package that anybody else could register there.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
from functools import cache

from kb import __version__
from kb.core.resources import lock_file

_LABELS = ("source", "repository", "github", "homepage")  # of a package's addresses, best first


def install_extra(extra: str = "") -> str:
    """How to install an optional part of the software, or with "" the software itself."""
    package = f'".[{extra}]"' if extra else "."
    return f"run `make setup` in the checkout of Lorecrawl, or `pip install -e {package}` there"


def software() -> str:
    """Name, version, address (where the package declares one) and lock file of this software."""
    facts = [software_address(), f"lock file SHA-256 {digest}" if (digest := lock_digest()) else ""]
    known = ", ".join(fact for fact in facts if fact)
    return f"Lorecrawl {__version__}" + (f" ({known})" if known else "")


@cache
def lock_digest() -> str:
    """SHA-256 of the file of locked dependencies; empty where the installation has none."""
    path = lock_file()
    return hashlib.sha256(path.read_bytes()).hexdigest() if path is not None else ""


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
