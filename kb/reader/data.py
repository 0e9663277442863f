"""`kb.load`: the tables of downloaded or collected data, and what can be made from them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from kb import query
from kb.artifacts import remote_release, table_catalog
from kb.artifacts.table_catalog import Catalog, View
from kb.core.config.addresses import address_of
from kb.reader import clips, html, recipe_tree, thread, video, wiki_page
from kb.reader.hints import with_hints
from kb.reader.tables import OpenTables, QueryResult, Tables, TableView
from kb.search.ranking import Only, day_given

Place = str | os.PathLike[str]
_METHODS = ("sql", "video", "page", "recipe_tree", "thread", "clips", "search")


@with_hints
def load(
    *places: Place | Iterable[Place], storage_options: Mapping[str, Any] | None = None
) -> Data:
    """Open a data root, a `release/` folder, one release folder, or several of these together.

        import kb
        data = kb.load("release/")
        data = kb.load("lorecrawl-youtube", "lorecrawl-pairs")
        data = kb.load("hf://datasets/ORG/NAME")
        data = kb.load("s3://bucket/prefix", storage_options={"anon": True})

    The default is the folder `data`. Only lists the files, which are read when needed. Nothing is
    written or sent, and no key or profile is needed.

    A release may also be at any address that fsspec knows. Of its tables only what is asked for
    is read. The pages of a table are verified by their checksums, but not for `sql` and what is
    made by it. Nothing is kept on this machine, unless an address such as `blockcache::s3://…`
    says where (`storage_options={"blockcache": {"cache_storage": "cache"}}`). `storage_options` are
    fsspec's.

    Raises UsageError for a folder that does not exist, FatalError for one without tables or without
    permission to read it, DamagedData if a file is missing, MissingExtra without the package that
    an address needs.
    """
    given: list[Place] = []
    for place in places or ("data",):
        given += [place] if isinstance(place, str | os.PathLike) else place
    remote = [address for place in given if (address := address_of(place))]
    local = [Path(place) for place in given if not address_of(place)]
    views = [
        view for address in remote for view in remote_release.read_views(address, storage_options)
    ]
    return Data([table_catalog.read_catalog(path) for path in local], views)


class Data:
    """Tables, wiki pages, Reddit threads and clips; made by `kb.load`."""

    def __init__(self, catalogs: Sequence[Catalog], remote: Iterable[View] = ()) -> None:
        self._opened = OpenTables(catalogs, remote)
        self.tables = Tables(self._opened.views)

    @with_hints
    def __getitem__(self, name: str) -> TableView:
        """A table by its name. Raises UnknownTable, which is also a KeyError.

        data["youtube_videos"].to_pandas()
        """
        return self.tables[name]

    def __contains__(self, name: object) -> bool:
        return name in self.tables

    @with_hints
    def sql(self, query_: str, /) -> QueryResult:
        """The result of a query over all tables, in DuckDB's SQL. It can only read.

            data.sql("SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL").to_pandas()

        Raises UsageError for a wrong query, DamagedData for a damaged file.
        """
        rows = query.select(self._opened.con, query_, views=self._opened.views)
        return QueryResult(rows.read_all())

    @with_hints
    def video(self, video_id: str, /) -> video.Video:
        """A video by its id, with its transcript where there is one, pairs, tasks and links.

            data.video("dQw4w9WgXcQ").pairs.to_pandas()

        Raises UsageError for an unknown id.
        """
        return video.find(self._opened, video_id)

    @with_hints
    def page(self, id_or_title: int | str, /) -> wiki_page.Page:
        """A wiki page by its id or title. Raises UsageError with the nearest titles.

        data.page("Creeper").screenshot()
        data.page("Creeper").boxes("table").draw()
        """
        return wiki_page.find(self._opened, id_or_title)

    @with_hints
    def recipe_tree(self, name: str, /, quantity: int = 1) -> dict[str, Any]:
        """What has to be made and gathered for so many of a thing, by the wiki's recipes.

            data.recipe_tree("Diamond Pickaxe")

        Nested dictionaries: `item`, `page_id`, `quantity`, `station`, `recipe_id` and `needs`, a
        list of the same, empty for what no recipe makes. Of several recipes one is followed, of
        alternatives the first. A thing that is above itself has no `needs` and `cycle = True`.

        Raises UsageError for a name that no recipe has.
        """
        return recipe_tree.RecipeGraph(self._opened).tree(name, quantity)

    @with_hints
    def thread(self, post_id: str, /) -> thread.Thread:
        """A Reddit post with its comments, nested; without texts in a release alone.

            print(data.thread("abc123"))

        Raises UsageError for an unknown id.
        """
        return thread.find(self._opened, post_id)

    @with_hints
    def clips(
        self,
        keyword: str | None = None,
        /,
        where: str = "",
        *,
        pairs: str | os.PathLike[str] | None = None,
    ) -> clips.Clips:
        """The clips of a keyword, or of all, with their videos' titles and figures, available
        texts, and what is known of their quality.

            data.clips("creeper").to_pandas()[["title", "url", "text"]]
            data.clips("creeper", "timing = 'word' AND duplicate_of IS NULL AND language = 'en'")
            data.clips("creeper").torch(videos="films")     # a PyTorch dataset; docs/train.md
            data.clips(None, "split = 'train'", pairs="draw/pairs.parquet")  # of `kb pairs draw`

        `where` is a condition in DuckDB's SQL. `text` is null in a release alone. Raises UsageError
        with the nearest keywords.
        """
        drawn = Path(pairs) if pairs is not None else None
        return clips.find(self._opened, keyword, where, drawn)

    @with_hints
    def search(
        self,
        words: str,
        /,
        *,
        source: str | Iterable[str] = (),
        kind: str | Iterable[str] = (),
        entity: str = "",
        since: str = "",
        until: str = "",
        least_score: float = 0.0,
        each: int | None = 1,
        limit: int = 10,
        size: int = 1000,
    ) -> QueryResult:
        """Ranked answers from the local index that `kb index` builds; best first.

            data.search("how to tame a fox", kind="transcript").to_pandas()[["url", "snippet"]]

        Columns: text, snippet, source, kind, key, title, path, score, url, licence, date, start_s.
        `entity`: only answers that mention this keyword of the profile, as found by `kb links`.
        `each`: answers per video, page or thread, None for all; `size`: characters of a text.
        An index that is missing or out of date is built first, in the data root, or in the user's
        cache for a download. Raises UsageError if there are no texts, and for releases that are
        read at an address.
        """
        from kb.reader import search  # noqa: PLC0415  it needs pydantic, which takes a second

        days = day_given("since", since), day_given("until", until)
        only = Only(_several(kind), *days, least_score, each, limit)
        return search.find(self._opened, words, _several(source), only, size, entity)

    def _repr_html_(self) -> str:
        methods = ", ".join(["data[name]", *(f"data.{method}(…)" for method in _METHODS)])
        caption = f"<b>Lorecrawl</b> {html.text(', '.join(self._opened.folders()), 400)}"
        return html.block(
            self.tables._repr_html_() + f"<small>{html.text(methods)}</small>", caption=caption
        )

    def __repr__(self) -> str:
        return f"<kb data in {', '.join(self._opened.folders())}: {', '.join(self.tables)}>"


def _several(given: str | Iterable[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)
