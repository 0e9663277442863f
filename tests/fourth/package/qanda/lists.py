"""The lists of the site's API.

GET /questions?page=N              {"items": [{"question_id": 11}, …], "has_more": true}
GET /questions/11;12               whole questions, without those that were deleted
GET /questions/11;12/answers       their answers, in pages
"""

from kb.crawl.json_lists import ListPhase

LISTS = (
    ListPhase(
        kind="answers",
        table="questions",
        unit="questions",
        path="/questions/{keys}/answers",
        batch=20,
    ),
    ListPhase(
        kind="questions",
        table="questions",
        unit="questions",
        path="/questions/{keys}",
        key="question_id",
        adds={"answers": "question_id"},
        feeds=("answers",),
        batch=20,
        limited=True,
    ),
    ListPhase(
        kind="pages",
        unit="pages",
        path="/questions",
        adds={"questions": "question_id"},
        feeds=("questions",),
    ),
)
