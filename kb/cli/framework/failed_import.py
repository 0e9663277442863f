"""What follows when an import fails: the right command is named, and nothing is left behind."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from kb.artifacts.data_roots import is_root
from kb.core.context import Run
from kb.core.errors import FatalError, UsageError
from kb.core.sources import SOURCES
from kb.store import lock
from kb.store.rawlog import rawlog


@contextmanager
def importing(
    run: Run, given: Sequence[Path], other: str, is_other: Callable[[Path], bool]
) -> Iterator[None]:
    """Around an import. When it fails, files of the `other` source are told their command, and a
    data root that was begun for it goes.
    """
    existed, had_data = run.root.exists(), is_root(run.root)
    try:
        yield
    except (UsageError, FatalError) as error:
        if wrong := next(filter(is_other, given), None):
            error.hint = f"run `kb {other} import {wrong}`, which reads what is there"
        answered = any(rawlog.any_answer(run.root, source) for source in SOURCES)
        if not (had_data or answered or lock.holders(run.root)):
            for name in ("raw", "state"):
                shutil.rmtree(run.root / name, ignore_errors=True)
            if not existed:
                with suppress(OSError):  # somebody else has put something there
                    run.root.rmdir()
        raise
