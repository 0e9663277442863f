"""Where the files that travel with the code are: in a wheel or beside kb/ in a checkout."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from kb.core.errors import DamagedData

PROFILE_FILE = "profile.toml"  # its name in a folder of its own, and in a release folder
_CHECKOUT = {"schemas": "schemas", "pipelines": "pipelines", "profiles": "data/profiles"}


def lock_file() -> Path | None:
    """The exact versions that Lorecrawl is tested with; None where they were not installed."""
    package = Path(__file__).resolve().parent.parent
    places = (package / "requirements.lock", package.parent / ".ci" / "requirements.lock")
    return next((path for path in places if path.is_file()), None)


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
