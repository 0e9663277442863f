"""What was downloaded or crawled, in Python: `data = kb.load("release/")`, made for a notebook.

    data.tables                         what is there
    data["youtube_videos"]              a table: .to_pandas(), .to_polars(), .to_table(), .schema
    data.sql("SELECT …")                an answer, with the same ways out
    data.page("Creeper")                a wiki page: .screenshot(), .boxes("table").draw()
    data.thread("abc123")               a post and its comments, nested
    data.clips("creeper")               clips of a keyword, with their videos and texts
    data.search("tame a wolf")          ranked answers out of the index of `kb index`

Nothing is sent or asked for: no key, no network. Tables are in `rows`, HTML in `html`; pages in
`page` and `image`, the rest by its own name.
"""

from kb.reader.data import Data, load
from kb.reader.image import Box
from kb.reader.page import Boxes, Page
from kb.reader.rows import QueryResult, RowSet, TableView
from kb.reader.tables import Tables
from kb.reader.thread import Thread, ThreadComment

__all__ = [
    "Box",
    "Boxes",
    "Data",
    "Page",
    "QueryResult",
    "RowSet",
    "TableView",
    "Tables",
    "Thread",
    "ThreadComment",
    "load",
]
