"""What `kb search` and `read` show of a question and its answers."""

from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import UsageError
from kb.mcp.documents import AgentDocument, DocumentPart, SourceLocation, first_row, outward
from kb.reader.tables import OpenTables
from kb.search.passage import Passage, day, plain, rows
from kb.store.tables.merge import RowsByKey

QUESTION = ["question_id", "title", "body", "created_at"]
ANSWER = ["answer_id", "question_id", "body"]


def passages(root: Path, url: str) -> Iterator[Passage]:
    """Questions, each with its answers."""
    answers = RowsByKey(rows(root, "qanda/answers", ANSWER), "question_id")
    for row in rows(root, "qanda/questions", QUESTION):
        key, title, date = row["question_id"], plain(row["title"]), day(row["created_at"])
        there = f"{url}/questions/{key}"
        yield Passage("question", f"q{key}", key, title, plain(row["body"]), there, date)
        for answer in answers.rows_of(key):
            at, body = answer["answer_id"], plain(answer["body"])
            yield Passage("answer", f"a{at}", key, title, body, f"{there}#{at}", date)


def document(tables: OpenTables, place: SourceLocation) -> AgentDocument:
    """A question and its answers."""
    question = first_row(tables, "qanda_questions", "question_id = ?", [place.key])
    if question is None:
        raise UsageError(f"unknown question {place.key[:40]!r}", hint="`search` returns refs")
    parts = [DocumentPart(place._replace(at=""), "question", "", plain(question["body"]))]
    for table in tables.ranked("qanda_answers")[:1]:
        sql = f"FROM {table.full} WHERE question_id = ? ORDER BY answer_id"
        for answer in tables.rows(sql, [place.key]).to_pylist():
            at = place._replace(at=answer["answer_id"])
            parts.append(DocumentPart(at, "answer", "", plain(answer["body"])))
    centre = next((n for n, part in enumerate(parts) if part.place.at == place.at), 0)
    nearest = outward(centre, len(parts))
    return AgentDocument("question and answers", plain(question["title"]), parts, nearest)
