"""Raw answers of YouTube → kept videos, their transcripts, and why the others are left out.

python youtube_filter.py RAW OUT THREADS
"""

import sys

import duckdb

GAME, CATEGORY, KEYWORD = (
    "UCQvWX73GQygcwXOTSf_VDVg",
    "20",
    r"(?i)(^|[^\pL\pN_])minecraft($|[^\pL\pN_])",
)
ITEM = """STRUCT(id VARCHAR,
    snippet STRUCT(publishedAt TIMESTAMP, channelId VARCHAR, title VARCHAR, description VARCHAR,
        channelTitle VARCHAR, tags VARCHAR[], categoryId VARCHAR),
    contentDetails STRUCT(duration VARCHAR, contentRating STRUCT(ytRating VARCHAR)),
    status STRUCT(license VARCHAR, privacyStatus VARCHAR),
    statistics STRUCT(viewCount VARCHAR, likeCount VARCHAR, commentCount VARCHAR),
    player STRUCT(embedWidth INT, embedHeight INT))"""
TRACK = """STRUCT(video_id VARCHAR, outcome VARCHAR, kind VARCHAR, language VARCHAR,
    cues STRUCT(start_s DOUBLE[], duration_s DOUBLE[], text VARCHAR[], word_start_s DOUBLE[][]),
    player STRUCT(width INT, height INT, fps INT, game_label_id VARCHAR))"""
READ = "format = 'newline_delimited', compression = 'zstd'"
PARQUET = "(FORMAT parquet, COMPRESSION zstd)"

raw, out, threads = sys.argv[1:4]
db = duckdb.connect(config={"threads": int(threads), "preserve_insertion_order": False})
db.execute(f"""
    CREATE TABLE answers AS SELECT fetched_at, request.params.id AS asked, response.items
    FROM read_json('{raw}/videos/*.zst', {READ}, columns = {{fetched_at: 'TIMESTAMP',
        request: 'STRUCT(params STRUCT(id VARCHAR))', response: 'STRUCT(items {ITEM}[])'}});
    CREATE TABLE tracks AS SELECT unnest(response) FROM (
        FROM read_json('{raw}/transcripts/*.zst', {READ},
            columns = {{fetched_at: 'TIMESTAMP', response: '{TRACK}'}})
        QUALIFY row_number() OVER (PARTITION BY response.video_id ORDER BY fetched_at DESC) = 1);
    CREATE TABLE videos AS
    WITH items AS (SELECT fetched_at, unnest(items) AS item FROM answers), latest AS (FROM items
        QUALIFY row_number() OVER (PARTITION BY item.id ORDER BY fetched_at DESC) = 1), newest AS (
        SELECT item.id AS video_id, unnest(item.snippet), item.contentDetails.duration,
            item.contentDetails.contentRating.ytRating AS rating, item.status.license,
            item.status.privacyStatus AS availability,
            try_cast(item.statistics.viewCount AS BIGINT) AS view_count,
            try_cast(item.statistics.likeCount AS BIGINT) AS like_count,
            try_cast(item.statistics.commentCount AS BIGINT) AS comment_count,
            item.player.embedWidth AS embed_width, item.player.embedHeight AS embed_height
        FROM latest)
    SELECT newest.*, outcome, kind AS transcript_kind, player.fps AS fps,
        coalesce(player.width, embed_width) AS width,
        coalesce(player.height, embed_height) AS height,
        coalesce(try_cast(regexp_extract(duration, '(\\d+)H', 1) AS INT), 0) * 3600
            + coalesce(try_cast(regexp_extract(duration, '(\\d+)M', 1) AS INT), 0) * 60
            + coalesce(try_cast(regexp_extract(duration, '(\\d+)S', 1) AS INT), 0) AS duration_s,
        len(list_filter(string_split(replace(array_to_string(cues.text, ' '), chr(10), ' '), ' '),
            lambda word: word <> '')) AS word_count,
        CASE WHEN availability IN ('private', 'unlisted') THEN 'not_public'
            WHEN coalesce(player.game_label_id <> '{GAME}', categoryId <> '{CATEGORY}'
                OR NOT regexp_matches(concat_ws(chr(10), title, array_to_string(tags, chr(10)),
                    description), '{KEYWORD}')) THEN 'topic'
            WHEN view_count IS NULL OR view_count < 100 THEN 'views'
            WHEN width < height THEN 'aspect_ratio'
            WHEN duration_s < 60 THEN 'duration'
            WHEN rating = 'ytAgeRestricted' OR outcome = 'age_restricted' THEN 'age_restricted'
            WHEN outcome IS DISTINCT FROM 'ok' OR word_count = 0 THEN 'transcript' END AS reason
    FROM newest LEFT JOIN tracks USING (video_id);
    COPY (SELECT * EXCLUDE (reason, outcome) FROM videos WHERE reason IS NULL ORDER BY video_id)
    TO '{out}/videos.parquet' {PARQUET};
    COPY (SELECT video_id, title, reason FROM videos WHERE reason IS NOT NULL
        UNION ALL SELECT id, NULL, 'missing'
        FROM (SELECT unnest(string_split(asked, ',')) AS id FROM answers)
        WHERE id NOT IN (SELECT video_id FROM videos))
    TO '{out}/rejected.parquet' {PARQUET};
    -- A cue of an automatic track is shown on while the next one is spoken.
    COPY (SELECT video_id, kind, language, list_transform(
            list_zip(cues.start_s, cues.duration_s, cues.text,
                coalesce(cues.word_start_s, []), cues.start_s[2:]),
            lambda cue: {{start_s: cue[1], duration_s: CASE WHEN kind = 'asr'
                THEN least(cue[2], round(cue[5] - cue[1], 3)) ELSE cue[2] END,
                text: cue[3], word_start_s: cue[4]}}) AS cues
        FROM tracks SEMI JOIN (FROM videos WHERE reason IS NULL) USING (video_id)
        ORDER BY video_id)
    TO '{out}/transcripts.parquet' {PARQUET};
""")
