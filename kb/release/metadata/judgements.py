"""What people said of a sample of pairs or tasks: sentences for card and datasheet."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from duckdb import DuckDBPyConnection

from kb.artifacts.measures import read_measures
from kb.artifacts.release_folder import ReleaseFolder
from kb.store.layout import Layout


def task_quality(con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> tuple[str, ...]:
    """The sentences of released tasks. Raises DamagedData."""
    return tuple(judgements(read_measures(Layout(root).pairs), "task"))


def judgements(measures: Mapping[str, Any], kind: str) -> Iterator[str]:
    """A sentence for each question about a "pair" or "task" that has an answer, or that nobody has
    judged any. `measures` are the sections of pairs/measures.json.
    """
    section = measures.get("labels", {}).get(kind)
    if not section or not section["items"]:
        yield f"Not judged yet: nobody has looked at a sample of these {kind}s."
        return
    people, items = section["annotators"], section["items"]
    who = f"{people} people" if people > 1 else "one person"
    yield (
        f"Judged by people: {who} judged {items:,} {kind}{'s' if items > 1 else ''} of a stratified"
        f" sample; the shares are those of all {kind}s."
    )
    for one in section["questions"].values():
        if one.get("n"):
            good = one["good"][0].upper() + one["good"][1:]
            yield f"{one['question']} {good} for {share_text(one)}{_kappa(one['agreement'])}."


def _kappa(agreement: dict[str, Any] | None) -> str:
    if agreement is None or agreement["kappa"] is None:
        return ""
    name = {"cohen": "Cohen's", "fleiss": "Fleiss'"}[agreement["method"]]
    return f"; {name} kappa {agreement['kappa']:.2f} over {agreement['items']:,}"


def share_text(share: Mapping[str, Any]) -> str:
    """ "95.0% (95 % interval 94.5% to 95.5%, n = 7,000)"; "none" of nothing."""
    if share["share"] is None:
        return "none"
    low, high, n = share["low"], share["high"], share["n"]
    return f"{share['share']:.1%} (95 % interval {low:.1%} to {high:.1%}, n = {n:,})"
