"""Raw answers of Reddit → kept posts and comments, and why the others are left out.

python reddit_filter.py RAW OUT THREADS
"""

import json
import sys

import duckdb

FIELDS = {
    **dict.fromkeys(("id", "title", "selftext", "body", "author", "link_id"), "VARCHAR"),
    **dict.fromkeys(("parent_id", "url", "domain"), "VARCHAR"),
    **dict.fromkeys(("score", "num_comments", "created_utc"), "BIGINT"),
    "upvote_ratio": "DOUBLE",
    "over_18": "BOOLEAN",
}
THING = {"kind": "VARCHAR", "data": {**FIELDS, "replies": "JSON"}}
LISTING = {"data": {"children": [THING]}}
FLAT = f"STRUCT({', '.join(f'{name} {kind}' for name, kind in FIELDS.items())})"
READ = "format = 'newline_delimited', compression = 'zstd', maximum_object_size = 100000000"
PARQUET = "(FORMAT parquet, COMPRESSION zstd)"
GONE = "('[deleted]', '[removed]')"

raw, out, threads = sys.argv[1:4]
db = duckdb.connect(config={"threads": int(threads), "preserve_insertion_order": False})
db.execute(f"""
    CREATE TABLE flat AS SELECT fetched_at, unnest(response.data.children) AS thing
    FROM read_json(['{raw}/dumps/*.zst', '{raw}/listings/*.zst'], {READ}, columns = {{
        fetched_at: 'TIMESTAMP',
        response: 'STRUCT(data STRUCT(children STRUCT(kind VARCHAR, data {FLAT})[]))'}});
    CREATE TABLE trees AS
    WITH RECURSIVE level AS (
        SELECT fetched_at, unnest(listing.data.children) AS thing
        FROM (SELECT fetched_at, unnest(json_transform(response, '{json.dumps([LISTING])}'))
                AS listing
            FROM read_json('{raw}/comments/*.zst', {READ},
                columns = {{fetched_at: 'TIMESTAMP', response: 'JSON'}}))
        UNION ALL
        SELECT fetched_at, unnest(json_transform(thing.data.replies, '{json.dumps(LISTING)}')
            .data.children)
        FROM level WHERE json_type(thing.data.replies) = 'OBJECT')
    FROM level;
    CREATE TABLE things AS
    WITH every AS (
        SELECT fetched_at, thing.kind AS kind, unnest(thing.data) FROM flat
        UNION ALL BY NAME
        SELECT fetched_at, kind, COLUMNS(* EXCLUDE (fetched_at, kind, replies))
        FROM (SELECT fetched_at, thing.kind AS kind, unnest(thing.data) FROM trees))
    FROM every
    QUALIFY row_number() OVER (PARTITION BY kind, id ORDER BY fetched_at DESC) = 1;
    CREATE TABLE posts AS SELECT *, CASE WHEN title IS NULL OR selftext IN {GONE} THEN 'removed'
        WHEN over_18 THEN 'nsfw' WHEN score < 5 THEN 'score' END AS reason
    FROM things WHERE kind = 't3';
    CREATE TABLE comments AS SELECT things.*, things.link_id[4:] AS post_id,
        CASE WHEN posts.id IS NULL THEN 'post' WHEN things.body IN {GONE} THEN 'removed' END AS why
    FROM things LEFT JOIN (FROM posts WHERE reason IS NULL) AS posts
        ON things.link_id[4:] = posts.id
    WHERE things.kind = 't1';
    COPY (SELECT id AS post_id, * EXCLUDE (id, body, link_id, parent_id, reason),
            (SELECT count(*) FROM comments WHERE post_id = posts.id AND why IS NULL) AS released
        FROM posts WHERE reason IS NULL ORDER BY id)
    TO '{out}/posts.parquet' {PARQUET};
    COPY (SELECT id AS comment_id, post_id, parent_id, body, author, score, created_utc, fetched_at
        FROM comments WHERE why IS NULL ORDER BY post_id, id)
    TO '{out}/comments.parquet' {PARQUET};
    COPY (SELECT id, reason FROM posts WHERE reason IS NOT NULL
        UNION ALL SELECT id, why FROM comments WHERE why IS NOT NULL)
    TO '{out}/rejected.parquet' {PARQUET};
""")
