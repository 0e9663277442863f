"""Print every package of a lock that has neither a wheel nor a pure source for an interpreter and
platform that we support (`interpreter.py`), and exit with 1 if there is one.

    .venv/bin/python .ci/wheels.py pylock.toml

The file is one of PEP 751, with every file of each package.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from interpreter import GLIBC, MACOS, PLATFORMS, PYTHONS
from packaging.markers import Marker
from packaging.tags import Tag, compatible_tags, cpython_tags, mac_platforms
from packaging.utils import parse_wheel_filename


def tags(minor: int, system: str, machine: str) -> set[Tag]:
    """Those of the wheels that CPython 3.`minor` takes on the oldest such system."""
    if system == "Darwin":
        platforms = list(mac_platforms(MACOS, machine))
    else:
        platforms = [f"manylinux_2_{old}_{machine}" for old in range(5, GLIBC[1] + 1)]
        platforms += [f"manylinux{old}_{machine}" for old in ("1", "2010", "2014")]
    return {
        *cpython_tags((3, minor), platforms=platforms),
        *compatible_tags((3, minor), f"cp3{minor}", platforms),
    }


def environment(minor: int, system: str, machine: str) -> dict[str, str]:
    """What markers are about."""
    return {
        "implementation_name": "cpython",
        "os_name": "posix",
        "platform_machine": machine,
        "platform_python_implementation": "CPython",
        "platform_system": system,
        "python_full_version": f"3.{minor}.0",
        "python_version": f"3.{minor}",
        "sys_platform": system.lower(),
    }


@cache
def is_pure(requirement: str) -> bool:
    """Whether the source makes a wheel for any platform."""
    with tempfile.TemporaryDirectory() as folder:
        make = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder]
        subprocess.run([*make, requirement], check=False, stdout=sys.stderr)
        return any(Path(folder).glob("*-none-any.whl"))


def missing(packages: list[dict[str, Any]]) -> Iterator[tuple[str, str, int]]:
    """Package, platform and minor version of Python of each gap."""
    for minor in PYTHONS:
        for system, machine in PLATFORMS:
            taken, about = tags(minor, system, machine), environment(minor, system, machine)
            for package in packages:
                if "marker" in package and not Marker(package["marker"]).evaluate(about):
                    continue
                requirement = f"{package['name']}=={package['version']}"
                wheels = package.get("wheels", [])
                names = [wheel.get("name") or wheel["url"].rpartition("/")[2] for wheel in wheels]
                if any(parse_wheel_filename(name)[3] & taken for name in names):
                    continue
                if "sdist" not in package or not is_pure(requirement):
                    yield requirement, f"{system} {machine}", minor


def main() -> None:
    packages = tomllib.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["packages"]
    gaps: dict[tuple[str, str], list[int]] = defaultdict(list)
    for requirement, place, minor in missing(packages):
        gaps[requirement, place].append(minor)
    for (requirement, place), minors in sorted(gaps.items()):
        versions = ", ".join(f"3.{minor}" for minor in minors)
        print(f"no wheel and no pure source: {requirement} for Python {versions} on {place}")
    sys.exit(bool(gaps))


if __name__ == "__main__":
    main()
