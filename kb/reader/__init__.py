"""Reads collected or downloaded data in Python: `data = kb.load("release/")`, made for notebooks.

    data.tables                         all tables
    data["youtube_videos"]              a table: .to_pandas(), .to_polars(), .to_arrow(), .to_hf();
                                        .columns, .schema; it iterates, slices and prints itself
    data.sql("SELECT …")                a result, which can do the same
    data.video("dQw4w9WgXcQ")           a video with its transcript, pairs, tasks and links
    data.page("Creeper")                a wiki page: .screenshot(), .boxes("table").draw()
    data.thread("abc123")               a post and its comments, nested
    data.clips("creeper")               clips of a keyword, with their videos and texts
    data.clips("creeper").torch("films")    the same as a PyTorch dataset
    data.search("tame a wolf")          ranked answers from the index of `kb index`

Needs no key and no network. `tables` has tables and results, `wiki_page` the pages, `html` what
notebooks show.
"""

from kb.reader.clips import Clips
from kb.reader.data import Data, load
from kb.reader.tables import QueryResult, RowSet, Tables, TableView
from kb.reader.thread import Thread, ThreadComment
from kb.reader.video import Video
from kb.reader.wiki_page import Box, Boxes, Page

__all__ = [
    "Box",
    "Boxes",
    "Clips",
    "Data",
    "Page",
    "QueryResult",
    "RowSet",
    "TableView",
    "Tables",
    "Thread",
    "ThreadComment",
    "Video",
    "load",
]
