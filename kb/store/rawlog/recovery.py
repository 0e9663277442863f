"""Open segments of the raw log after their writer ended, however it did."""

from __future__ import annotations

import os
from pathlib import Path

from kb.store.atomic import sync_folder
from kb.store.rawlog.rawlog import Frames, kinds, segments


def recover(root: Path, source: str) -> None:
    """Cut torn frames off the ends of open segments and close them.

    Called under the writer's lock, before anything is written, and after
    `kb.store.rawlog.damaged_answers` took out committed answers that can't be read: only bytes
    that no state knows are cut.
    """
    for kind in kinds(root, source):
        for path in segments(root, source, kind):
            if not path.name.endswith(".open"):
                continue
            frames = Frames(path, mending=True)
            for _ in frames:
                pass
            if frames.torn:
                with path.open("r+b") as file:
                    file.truncate(frames.good)
                    os.fsync(file.fileno())
            if frames.good == 0:
                path.unlink()
            else:
                os.rename(path, path.with_name(path.name.removesuffix(".open")))
            sync_folder(path.parent)
