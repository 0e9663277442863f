"""Raw answers of the site → kept questions, and the answers to these."""

from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import pyarrow as pa
import pyarrow.compute as pc

from kb.annotate import toxicity
from kb.core.config.profile import Profile
from kb.filters.chain import Chain, Clean, RawRows
from kb.filters.predicates import AtLeast, In, none_above
from kb.schema.decode import ColumnReader
from kb.schema.tables import table
from kb.store.tables.partition import RawKind
from qanda.section import QAndASection

BODY = {"body": "toxicity"}  # texts that are scored → the column of the score


def parse(kind: str, lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Raw answers of a kind → the columns of its table."""
    for rows, _ in ColumnReader(table(f"qanda/{kind}"), kind).tables(lines):
        yield rows


def with_question(rows: pa.Table, kept: Mapping[str, pa.Table]) -> pa.Table:
    """Whether the question of an answer is kept."""
    questions = kept["qanda/questions"]["question_id"]
    return rows.append_column("question", pc.is_in(rows["question_id"], value_set=questions))


def clean(p: Profile) -> Clean:
    """The stages of both tables."""
    score = AtLeast("score", p.section(QAndASection).min_score, "score", "qanda.min_score")
    civil = none_above(p.toxicity.threshold("qanda"), BODY, "toxicity.thresholds.qanda")
    keys = {"questions": "question_id", "answers": "answer_id"}
    return Clean(
        source="qanda",
        raw=RawRows(
            {kind: RawKind(partial(parse, kind), (keys[kind],), "question_id") for kind in keys},
            lambda newest: {f"qanda/{kind}": newest[kind] for kind in keys if kind in newest},
        ),
        chains=(
            Chain("qanda/questions", "question_id", (score, *civil), "q", BODY),
            Chain(
                "qanda/answers",
                "answer_id",
                (In("question", (True,), stage="question"), score, *civil),
                "a",
                BODY,
                helpers=("question",),
                relate=with_question,
            ),
        ),
        scorer=toxicity,
    )
