"""SQL over the tables of a data root: views, allowed statements, and output of results.

    with connect(root) as con:
        reader = select(con, "FROM youtube_videos", root=root)      # a pyarrow.RecordBatchReader

views        one DuckDB view per table
statements   what a query may contain
execute      one query, here or in a process of its own, which `limits` bounds
formats      rows as a table, CSV, JSON or Parquet
"""

from kb.artifacts.table_catalog import View
from kb.query.execute import select
from kb.query.views import ViewInfo, catalog, connect, find_views

__all__ = [
    "View",
    "ViewInfo",
    "catalog",
    "connect",
    "find_views",
    "select",
]
