"""Scores of pairs from a pass over a film, without a data root."""

from pathlib import Path
from typing import Any

from kb.score.film_pass import watch_film
from kb.score.film_store import SeenFilm, Vectors, text_key
from kb.score.pair_scores import PairScore, needed_ticks, scores_of


def scored(path: Path, rows: list[dict[str, Any]], model: Any) -> list[PairScore]:
    """The scores of these pairs from a pass over the film."""
    ticks = sorted({tick for row in rows for tick in needed_ticks(row, model.step_s).tolist()})
    found = watch_film(path, ticks, model)
    texts = {text_key(row["text"]): model.texts([row["text"]])[0] for row in rows}
    vectors = Vectors("", dict(zip(found.ticks.tolist(), found.vectors, strict=True)), texts)
    seen = SeenFilm("", found.end_s, found.shots, found.motion, found.light)
    return list(scores_of(rows, seen, vectors, model))
