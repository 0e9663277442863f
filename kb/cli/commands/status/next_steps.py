"""The next commands for a data root, as `kb status` suggests them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kb.artifacts import manifest
from kb.cli.framework.messages import complete
from kb.core.sources import SPECS, made_of
from kb.store.layout import Layout, parquet_files

if TYPE_CHECKING:
    from kb.core.context import Run


def next_steps(run: Run, sources: dict[str, dict[str, Any]], links: dict[str, Any]) -> list[str]:
    """The next commands, as they have to be typed; one for each source that needs one.

    `sources` and `links` are those of the overview.
    """
    steps = [step for name, about in sources.items() if (step := _step(run, name, about))]
    if sources and not steps:
        steps = _of_all(run, sources, links)[:1]
    return [complete(step) for step in steps]


def _step(run: Run, source: str, about: dict[str, Any]) -> str:
    """The next command for a source: crawl, filter, refresh or export.

    A source with a credential is not crawled without it.
    """
    if about["running_pid"]:
        return ""
    spec, root = SPECS[source], run.root
    asks = not spec.credential or getattr(run.settings, spec.credential) is not None
    if asks and spec.refreshed and set(about["left_by"]) == {spec.noun(spec.refreshed)}:
        return f"refresh {source}"
    failed = sum(counts.get("error", 0) for counts in about["phases"].values())
    if asks and (about["left"] or failed):
        return f"{source} crawl"
    if Layout(root).raw(source).is_dir() and not manifest.is_current(root, f"clean/{source}"):
        return f"{source} filter"
    if asks and about["too_old"]:
        return f"refresh {source}"
    if Layout(root).summary(source).is_file() and not manifest.is_current(
        root, f"release/{source}"
    ):
        return f"{source} export"
    return ""


def _of_all(run: Run, sources: dict[str, dict[str, Any]], links: dict[str, Any]) -> list[str]:
    """What is not made yet, or not of today's rows, of what all sources lead to."""
    at = Layout(run.root)
    is_made = {
        "pairs": not any(map(sources.get, made_of("pairs"))) or bool(parquet_files(at.pairs)),
        "links": run.profile.pairs is None or bool(links and not links["older_than"]),
        "release": any(at.release().glob("*/SHA256SUMS")),
        "report": at.page.is_file(),
    }
    return [name for name, made in is_made.items() if not made]
