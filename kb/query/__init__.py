"""SQL over the tables of a data root: views, what may be run, and how an answer is printed.

    with connect(root) as con:
        answer = select(con, "FROM youtube_videos", root=root)      # a pyarrow.RecordBatchReader

Views are in `views`, statements in `statements`, the nearest names in `nearest`, printing in
`text` and `box`, files in `write`.
"""

from kb.artifacts.catalog import View
from kb.query.execute import select
from kb.query.views import Listed, catalog, connect, found

__all__ = ["Listed", "View", "catalog", "connect", "found", "select"]
