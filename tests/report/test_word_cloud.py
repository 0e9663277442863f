"""Word clouds."""

import re
from pathlib import Path

from kb.report.data import ReportData
from tests.release.made import rows
from tests.report.made import a_run


def test_word_cloud_counts_rows_not_mentions(root: Path) -> None:
    data = ReportData(a_run(root))
    found = dict(data.words("reddit/posts", ("title", "body"), set(), 200))
    texts = [
        set(re.findall(r"[a-z]+", f"{row['title']} {row['body']}"))
        for row in rows(120)["reddit/posts"]
    ]
    assert found["honey"] == sum("honey" in words for words in texts)
