"""What judgements say: shares with intervals, and how far people agree.

The sample is stratified, so each judged item stands for as many rows as its stratum has, divided by
how many of them were judged. An item that several people judged has the mean of their answers. The
interval is Wilson's with the effective size of the weighted sample (Kish), which is no larger than
the number of items.
"""

from __future__ import annotations

from typing import Any

from duckdb import DuckDBPyConnection

from kb.core.installation import np
from kb.core.summary import wilson_interval
from kb.labels.questions import NEAR_S, UNSURE, YES, Labeling, LabelQuestion


def figures(con: DuckDBPyConnection, labeling: Labeling) -> dict[str, Any]:
    """The section of a kind. `con` has the tables labels; items (kind, item_id, stratum, start_s,
    end_s) of what was judged; sizes (kind, stratum, size) of all rows.
    """
    con.execute(
        "CREATE OR REPLACE TEMP TABLE ratings AS"
        " SELECT question::VARCHAR AS question, item_id, annotator, answer, stratum, size, start_s,"
        " end_s FROM labels JOIN items USING (kind, item_id) JOIN sizes USING (kind, stratum)"
        " WHERE kind = $kind AND NOT ends_with(question, '_aligned')",  # of other clips
        {"kind": labeling.kind},
    )
    ((items, people),) = con.execute(
        "SELECT count(DISTINCT item_id), count(DISTINCT annotator) FROM ratings"
    ).fetchall()
    questions = {
        one.name: {"question": one.text, **_figures_of(con, one, labeling.kind)}
        for one in labeling.questions
        if not one.aligned
    }
    return {"items": items, "annotators": people, "questions": questions}


def _figures_of(con: DuckDBPyConnection, question: LabelQuestion, kind: str) -> dict[str, Any]:
    name = {"question": question.name}
    answers = con.execute(
        "SELECT answer, count(*) AS n FROM ratings WHERE question = $question GROUP BY 1"
        " ORDER BY n DESC, 1",
        name,
    ).fetchall()
    if not question.options and not question.compared:
        return {"answers": sum(n for _, n in answers)}
    near = f"abs(answer::DOUBLE - {question.compared}) <= {NEAR_S}"
    good = near if question.compared else f"answer = '{YES}'"
    ((n, covered, share, size),) = con.execute(
        f"""
        WITH judged AS (
            SELECT item_id, stratum, size, avg(({good})::INT) AS good
            FROM ratings WHERE question = $question AND answer <> '{UNSURE}' GROUP BY ALL),
        weighed AS (
            SELECT good, size / count(*) OVER (PARTITION BY stratum) AS weight
            FROM judged WHERE good IS NOT NULL)
        SELECT count(*), sum(weight) / (SELECT sum(size) FROM sizes WHERE kind = $kind),
            sum(weight * good) / sum(weight), sum(weight) ** 2 / sum(weight ** 2)
        FROM weighed""",
        {**name, "kind": kind},
    ).fetchall()
    low, high = wilson_interval(share * size, size) if n else (0.0, 1.0)
    return {
        "good": f"within {NEAR_S} s of {question.compared}" if question.compared else YES,
        "n": n,
        "share": round(share, 4) if n else None,
        "low": round(low, 4),
        "high": round(high, 4),
        "effective_n": round(size, 1) if n else 0,
        "covered": round(covered, 4) if n else 0,
        "answers": dict(answers) if question.options else sum(n for _, n in answers),
        "agreement": _agreement(con, name) if question.options else None,
    }


def _agreement(con: DuckDBPyConnection, name: dict[str, str]) -> dict[str, Any] | None:
    """Kappa of a question's answers, all options counted; None with one person."""
    ranks = (
        f"dense_rank() OVER (ORDER BY {one}) - 1" for one in ("item_id", "annotator", "answer")
    )
    sql = f"SELECT {', '.join(ranks)} FROM ratings WHERE question = $question"
    rows = np.array(con.execute(sql, name).fetchall(), np.int64).reshape(-1, 3)
    items, people, options = rows.max(axis=0, initial=-1) + 1
    if people < 2:
        return None
    chosen = np.full((items, people), -1)
    chosen[rows[:, 0], rows[:, 1]] = rows[:, 2]
    return agreement(chosen, int(options))


def agreement(chosen: np.ndarray, options: int) -> dict[str, Any]:
    """Cohen's kappa (1960) for two people, Fleiss' (1971) for more, over items that at least two
    people judged. `chosen`: an option's number for each item and person, -1 for none. `kappa` is
    None where every answer is the same.
    """
    counts = (chosen[:, :, None] == np.arange(options)).sum(axis=1)
    shared = counts.sum(axis=1) >= 2
    counts, judged = counts[shared], counts[shared].sum(axis=1)
    n = int(shared.sum())
    method = "cohen" if chosen.shape[1] == 2 else "fleiss"
    if not n:
        return {"method": method, "items": 0, "agreed": None, "kappa": None}
    agreed = float(((counts * (counts - 1)).sum(axis=1) / (judged * (judged - 1))).mean())
    if method == "cohen":
        first, second = (np.bincount(chosen[shared, one], minlength=options) for one in (0, 1))
        chance = float((first * second).sum() / n**2)
    else:
        chance = float(((counts.sum(axis=0) / counts.sum()) ** 2).sum())
    kappa = round((agreed - chance) / (1 - chance), 4) if chance < 1 else None
    return {"method": method, "items": n, "agreed": round(agreed, 4), "kappa": kappa}
