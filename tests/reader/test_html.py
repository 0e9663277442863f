"""Text of others is escaped in notebooks."""

from pathlib import Path

import kb
from kb.store.tables.shard_writer import write_table


def test_what_people_wrote_is_escaped(tmp_path: Path, make_rows) -> None:
    evil = '<script>alert("1")</script>\x1b[31m'
    given = {"post_id": ["p1"], "title": [evil], "body": [evil]}
    posts = make_rows("reddit/posts", 1, **given)
    write_table(tmp_path / "clean/reddit/posts/part-00000.parquet", posts, "reddit/posts")
    given = {"comment_id": ["c1"], "post_id": ["p1"], "parent_id": ["t3_p1"], "body": [evil]}
    comments = make_rows("reddit/comments", 1, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    data = kb.load(tmp_path)
    assert data.thread("p1").replies[0].body == evil
    for shown in (data["reddit_posts"], data.sql("FROM reddit_comments"), data.thread("p1")):
        text = shown._repr_html_()
        assert "&lt;script&gt;" in text
        assert "<script" not in text
        assert "\x1b" not in text
    assert "\x1b" not in str(data.thread("p1"))
