"""The whole job in small, on invented services: every step of the paper's data collection.

The steps are the commands that a user types; none knows that the services are invented.
"""

# Commands of `kb`, in order: each source, then what is made from all of them.
STEPS = [
    "youtube crawl",
    "youtube filter",
    "youtube export",
    "wiki crawl",
    "wiki filter",
    "wiki export",
    "reddit crawl",
    "reddit import",
    "refresh reddit",
    "reddit filter",
    "reddit export",
    "reddit reconstruct",
    "pairs",
    "tasks",
    "links",
    "index",
    "release",
    "report",
]

# (question, SQL over the shards, tables that it needs)
QUERIES = [
    (
        "Where did the transcripts of the kept videos come from?",
        """SELECT transcript_kind, count(*) AS videos, round(sum(duration_s) / 3600, 1) AS hours,
            sum(word_count) AS words
        FROM release.youtube_videos GROUP BY ALL ORDER BY videos DESC""",
        ["release.youtube_videos"],
    ),
    (
        "Why were videos left out?",
        (
            "SELECT stage, reason, count(*) AS videos FROM clean.youtube_rejected"
            " GROUP BY ALL ORDER BY videos DESC, stage, reason LIMIT 3"
        ),
        ["clean.youtube_rejected"],
    ),
    (
        "Which words match most clips, and how long are these?",
        """SELECT keyword, keyword_kind, count(*) AS clips,
            round(avg(clip_end_s - clip_start_s), 1) AS seconds
        FROM release.pairs GROUP BY ALL ORDER BY clips DESC, keyword LIMIT 3""",
        ["release.pairs"],
    ),
    (
        "What is posted, and how much is it talked about?",
        """SELECT type, count(*) AS posts, round(avg(score)) AS score, sum(num_comments) AS comments
        FROM release.reddit_posts GROUP BY ALL ORDER BY posts DESC, type LIMIT 3""",
        ["release.reddit_posts"],
    ),
    (
        "What is named in most places, and in which source?",
        """SELECT entity, kind, title AS wiki_page,
            sum(count) FILTER (source = 'youtube') AS videos,
            sum(count) FILTER (source = 'wiki') AS wiki,
            sum(count) FILTER (source = 'reddit') AS threads
        FROM links.links JOIN links.entities USING (entity)
            LEFT JOIN release.wiki_pages ON wiki_page_id = wiki_pages.page_id
        GROUP BY ALL ORDER BY sum(count) DESC, entity LIMIT 3""",
        ["links.links", "links.entities", "release.wiki_pages"],
    ),
]
