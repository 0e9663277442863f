"""`kb` as it is in a light `.venv`: `python tests/light.py WORDS`. Packages that
`make setup LIGHT=1` does not install can't be imported, and the mark of such an environment is
there.
"""

import importlib.machinery
import importlib.metadata
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LIGHT = {*(ROOT / ".ci" / "light.txt").read_text().split(), "lorecrawl", "pip", "setuptools"}


def absent() -> set[str]:
    """Modules at the top of packages that are not in the list."""
    normalized = {
        module: {re.sub("[-_.]+", "-", name).lower() for name in names}
        for module, names in importlib.metadata.packages_distributions().items()
    }
    return {module for module, names in normalized.items() if not names & LIGHT}


def main() -> None:
    """Hide them, then run `kb`."""
    hidden, find = absent(), importlib.machinery.PathFinder.find_spec

    def find_spec(name: str, path: object = None, target: object = None) -> object:
        return None if name.partition(".")[0] in hidden else find(name, path, target)  # type: ignore[arg-type]

    importlib.machinery.PathFinder.find_spec = find_spec  # type: ignore[assignment,method-assign]
    with tempfile.TemporaryDirectory() as prefix:
        Path(prefix, ".light").touch()
        sys.prefix = prefix
        sys.path.insert(0, str(ROOT))
        from kb.__main__ import main as kb

        sys.argv[0] = "kb"
        kb()


if __name__ == "__main__":
    main()
