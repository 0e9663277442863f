"""What released pages lack and what they answer, measured on them, for card and datasheet."""

from collections.abc import Iterator
from pathlib import Path

from duckdb import DuckDBPyConnection

from kb.artifacts.card_answers import CardAnswer, ask
from kb.artifacts.release_folder import ReleaseFolder, recognise
from kb.store.layout import Layout
from kb.store.tables.reading import scan

_PILLOW_LIMIT = 178_956_970  # pixels: twice Image.MAX_IMAGE_PIXELS, above which Pillow refuses


def gaps(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """Screenshots that Pillow does not open by default."""
    if not (shards := folder.shards("pages")):
        return
    pixels = "page_width * page_height * device_pixel_ratio * device_pixel_ratio"
    ((large,),) = con.execute(
        f"SELECT count(*) FROM {scan(shards)} WHERE {pixels} > {_PILLOW_LIMIT}"
    ).fetchall()
    if not large:
        return
    yield (
        f"{large:,} {'screenshot has' if large == 1 else 'screenshots have'} more than"
        f" {_PILLOW_LIMIT / 1e6:.1f} megapixels, which Pillow refuses to open until"
        " `PIL.Image.MAX_IMAGE_PIXELS = None` is set; `kb.load` opens them."
    )


# The thing with the most ingredients, and what it takes down to what is gathered.
_NEEDED = """\
WITH RECURSIVE needed AS (
    SELECT product AS thing, ingredient, ingredient_page_id, 1 AS depth FROM wiki_recipe_edges
    WHERE product = (SELECT product FROM wiki_recipe_edges GROUP BY 1
        ORDER BY count(DISTINCT ingredient) DESC, 1 LIMIT 1)
    UNION
    SELECT thing, edge.ingredient, edge.ingredient_page_id, depth + 1
    FROM needed JOIN wiki_recipe_edges AS edge ON edge.product = needed.ingredient WHERE depth < 8)
"""
QUESTIONS = {
    "What does a page say?": """\
SELECT title, text[:90] AS text FROM wiki_page_text JOIN wiki_pages USING (page_id)
ORDER BY wiki_page_text.word_count DESC, page_id LIMIT 1""",
    "Which pages link to it?": """\
SELECT target.title, list(DISTINCT page.title ORDER BY page.title)[:5] AS linked_from
FROM wiki_page_links AS link JOIN wiki_pages AS page USING (page_id)
JOIN wiki_pages AS target ON target.page_id = link.target_page_id
GROUP BY ALL ORDER BY count(DISTINCT page.page_id) DESC, target.title LIMIT 3""",
    "What is it filed under, and what else is it called?": """\
SELECT wiki_pages.title, list(DISTINCT category ORDER BY category) AS categories,
    list(DISTINCT redirect.title ORDER BY redirect.title) AS other_titles
FROM wiki_pages JOIN wiki_categories USING (page_id)
JOIN wiki_redirects AS redirect USING (page_id)
GROUP BY page_id, wiki_pages.title ORDER BY wiki_pages.title LIMIT 3""",
    "What does a recipe need, down to what is gathered?": f"""{_NEEDED}\
SELECT thing, list(DISTINCT ingredient ORDER BY ingredient) AS needs FROM needed GROUP BY ALL""",
    "Which videos and threads speak of each of these?": f"""{_NEEDED}\
SELECT ingredient, count(DISTINCT video_id) AS videos, count(DISTINCT post_id) AS threads
FROM needed JOIN entities ON wiki_page_id = ingredient_page_id JOIN links USING (entity)
GROUP BY ALL ORDER BY ALL LIMIT 8""",
}


def answers(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[CardAnswer]:
    """What a reader may ask of the pages, with the answers; of videos and threads where the links
    of the same data root are released.
    """
    links = recognise(Layout(root).release("links"))
    return ask(con, QUESTIONS, [folder, *([links] if links else [])])
