"""The second tracks of a sample of videos, in the form of the table youtube/transcripts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.store.rawlog import rawlog
from kb.store.tables.latest import newest
from kb.youtube.parse import answers
from kb.youtube.parse.assemble import assemble
from kb.youtube.spec import SPEC

(RAW_KIND,) = SPEC.samples


def second_tracks(
    root: Path, ids: Collection[str], words: Callable[[Any], pa.Array[Any]]
) -> Iterator[pa.Table]:
    """The tracks that were fetched of these videos, at most one each, some hundred at a time.

    `words` counts the words of each list of texts. Columns: those of youtube/transcripts; word
    times are checked. Raises DamagedData.
    """
    left = pa.array(sorted(ids), pa.string())
    for path in rawlog.segments(root, SPEC.name, RAW_KIND):
        for rows in answers.transcripts(line for _, line in rawlog.Frames(path)):
            tracks = assemble({"transcripts": rows}, words)["youtube/transcripts"]
            tracks = tracks.filter(pc.is_in(tracks["video_id"], value_set=left))
            yield newest(tracks, ("video_id",), ())
            found = tracks["video_id"].combine_chunks()
            left = left.filter(pc.invert(pc.is_in(left, value_set=found)))
