"""The stages of videos that were released once and are read again: nothing is judged twice."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.profile.youtube import YouTubeSection
from kb.filters.judgement import Judgement, Predicate, nothing
from kb.filters.predicates import NotTrue, Present
from kb.filters.topic import Topic

_NEEDED = ("view_count", "duration_s", "width", "height")  # columns of a row that is whole


class Evidence(Topic):
    """What shows the topic now. Nothing is rejected: it was judged when it was released."""

    def fill(self, rows: pa.Table) -> pa.Table:
        """As in a filter; "none" where nothing shows it any more."""
        rows = super().fill(rows)
        place = rows.column_names.index("topic_evidence")
        shown = pc.fill_null(rows["topic_evidence"], "none")
        return rows.set_column(place, "topic_evidence", shown)

    def judge(self, rows: pa.Table) -> Judgement:
        """All pass."""
        return Judgement(nothing(rows), nothing(rows), None)


def stages(section: YouTubeSection) -> tuple[Predicate, ...]:
    """What is still there passes, with what shows the topic now."""
    return (
        NotTrue("missing", stage="missing", reason="missing"),
        *(Present(column, stage="missing") for column in _NEEDED),
        Evidence(section.game_ids, section.category_ids, section.words),
    )
