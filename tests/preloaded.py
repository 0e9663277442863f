"""What the server of tests/forked.py imports before the first command: every module of `kb`.

Nothing is called here: a library that is only imported has started no thread that a fork loses.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import pkgutil

import kb

for _found in pkgutil.walk_packages(kb.__path__, "kb."):
    if not _found.name.endswith("__main__"):
        with contextlib.suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(_found.name)
gc.freeze()  # a collection in a fork would copy every page of these
