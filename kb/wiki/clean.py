"""`kb wiki filter`: raw answers and captured pages → clean/wiki, by the contract's stages.

    missing  the wiki did not return it       render    not captured after three tries
    robots   robots.txt forbids it            words, toxicity: the filters that the pipeline passes in

Pages are read in parts of a fixed size in order of their ids, so that the same raw data gives the
same files whatever the number of workers. The folder is swapped in whole.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError
from kb.core.verdict import Summary, Tally
from kb.store.atomic import replacing_folder, write_text
from kb.store.lock import writer
from kb.wiki import tables
from kb.wiki.index import Index, read_index

if TYPE_CHECKING:
    import pyarrow as pa

PART = 256  # pages a part file
SCRATCH = ".wiki-"
TABLES = ("pages", "elements", "cells", "images")
Row = dict[str, Any]


def clean(run: Run, filters: Sequence[Any], scorer: Any = None) -> Summary:
    """Judge every page that the wiki named. `scorer` is kb.annotate.toxicity, or None to leave scores out.

    Raises FatalError when nothing was crawled, CountMismatch, DamagedData, DiskFull.
    """
    # Without a model nothing is read or written: exit 2.
    model = scorer.check(run, "wiki") if scorer is not None else ""
    with writer(run.root, "wiki"):
        index = read_index(run.root)
        if not index.pages and not index.missing:
            raise FatalError(
                f"nothing to filter: {run.root / 'raw' / 'wiki'} has no pages", hint="run `kb wiki crawl` first"
            )
        verdicts = Verdicts()
        for left in (run.root / "clean").glob(f"{SCRATCH}*"):  # of a run that was killed
            shutil.rmtree(left, ignore_errors=True)
        score = partial(scorer.scores, model, run.root, "wiki") if model else None
        with tempfile.TemporaryDirectory(prefix=SCRATCH, dir=_made(run.root / "clean")) as scratch:
            parts = _assemble(run, index, verdicts, Path(scratch))
            if model:
                scorer.annotate(run, "wiki", _texts(parts))
            with replacing_folder(run.root / "clean" / "wiki") as fresh:
                for number, part in enumerate(parts):
                    _write_part(fresh, f"part-{number:05d}.parquet", part, filters, score, verdicts)
                verdicts.write(fresh)
                tally = verdicts.tally().check("wiki pages")
                summary = Summary(
                    source="wiki",
                    crawled=tally.crawled,
                    kept=tally.kept,
                    rejected=tally.rejected,
                    failed=tally.failed,
                    pending=tally.pending,
                    missing=len(index.missing),
                    stages=verdicts.stages(),
                    tables=dict(verdicts.rows),
                    unknown_keys={},
                )
                if not model:
                    summary["toxicity"] = "not scored"
                write_text(fresh / "summary.json", json.dumps(summary, indent=1) + "\n")
    return summary


def texts(run: Run) -> Iterator[Any]:
    """The visible text of every captured page, for `kb annotate wiki`."""
    index = read_index(run.root)
    with tempfile.TemporaryDirectory(prefix=SCRATCH, dir=_made(run.root / "clean")) as scratch:
        yield from _texts(_assemble(run, index, Verdicts(), Path(scratch)))


class Verdicts:
    """Every key's answer: kept, rejected with stage and reason, or pending."""

    def __init__(self) -> None:
        self.kept = 0
        self.total = 0
        self.rows: Counter[str] = Counter()
        self.rejected: list[Row] = []
        self.pending: list[Row] = []

    def reject(self, key: object, stage: str, reason: str, value: object = None, threshold: object = None) -> None:
        """A page that a stage dropped."""
        self.rejected.append(
            {
                "key": str(key),
                "stage": stage,
                "reason": reason,
                "value": None if value is None else str(value),
                "threshold": None if threshold is None else str(threshold),
            }
        )

    def wait(self, key: object, reason: str) -> None:
        """A page that waits for something."""
        self.pending.append({"key": str(key), "reason": reason})

    def tally(self) -> Tally:
        """The counts."""
        return Tally(self.total, self.kept, len(self.rejected), 0, len(self.pending))

    def stages(self) -> dict[str, int]:
        """How many were rejected, by stage."""
        return dict(sorted(Counter(row["stage"] for row in self.rejected).items()))

    def write(self, folder: Path) -> None:
        """The tables beside the kept rows."""
        for name, rows in (("rejected", self.rejected), ("failed", []), ("pending", self.pending)):
            _write(folder / name / "part-00000.parquet", f"shared/{name}", rows)


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write(path: Path, name: str, rows: list[Row]) -> None:
    import pyarrow as pa

    from kb.schema import table
    from kb.store.shards import write_table

    declared = table(name)
    names = declared.names()
    held = pa.Table.from_pylist([{column: row.get(column) for column in names} for row in rows], declared.arrow())
    write_table(path, held, declared)


# -- captured pages → rows -------------------------------------------------------------------------


def _assemble(run: Run, index: Index, verdicts: Verdicts, scratch: Path) -> list[Path]:
    """Sort out what was not captured; the rows of the rest, a file a part."""
    shown = []
    for title, reason in sorted(index.missing.items()):
        verdicts.reject(title, "missing", reason)
    for key, page in sorted(index.pages.items()):
        if page.shown is not None:
            fetched_at, render = page.shown
            shown.append({"info": page.infos[page.revision_id], "render": render, "fetched_at": fetched_at})
        elif page.problem is None:
            verdicts.wait(key, "render")
        elif page.problem["outcome"] == "robots":
            verdicts.reject(key, "robots", page.problem["reason"], page.problem["url"])
        else:
            verdicts.reject(key, "render", page.problem["reason"], page.problem.get("value"))
    verdicts.total = len(index.missing) + len(index.pages)
    url = run.settings.kb_wiki_url or run.profile.section("wiki").url
    site = tables.site_facts(index.site, url)
    tasks = []
    for start in range(0, len(shown), PART):
        pages = shown[start : start + PART]
        wanted = {file["key"] for page in pages for file in page["render"]["files"]}
        task = scratch / f"{start // PART:05d}.json"
        task.write_bytes(
            msgspec.json.encode(
                {
                    "pages": pages,
                    "site": site,
                    "files": {key: index.files[key] for key in sorted(wanted) if key in index.files},
                }
            )
        )
        tasks.append((str(run.root), str(task)))
    bar = run.progress.task("pages", len(shown), "pages")
    done: list[Path] = []
    with make_executor(run.engine, min(run.workers, max(1, len(tasks))), run.scheduler) as executor:
        for path, count in map_in_order(executor, part_rows, tasks, run.workers * 2):
            done.append(Path(path))
            bar.advance(count)
    bar.close()
    return done


def part_rows(root: str, task: str) -> tuple[str, int]:
    """One part, in a worker: its rows as one file beside the task, and how many pages."""
    work = msgspec.json.decode(Path(task).read_bytes())
    rows: dict[str, list[Row]] = {name: [] for name in TABLES}
    texts = []
    for page in work["pages"]:
        render = page["render"]
        key = int(render["page_id"])
        extraction = tables.read_extraction(Path(root) / render["folder"])
        rows["pages"].append(tables.page_row(page["info"], render, page["fetched_at"], work["site"], extraction))
        rows["elements"] += tables.element_rows(key, extraction)
        rows["cells"] += tables.cell_rows(key, extraction)
        rows["images"] += tables.image_rows(key, extraction, work["files"])
        texts.append(tables.page_text(extraction["elements"]))
    target = Path(task).with_suffix(".rows")
    target.write_bytes(msgspec.msgpack.encode({"rows": rows, "texts": texts}))
    return str(target), len(work["pages"])


# -- rows → verdicts and files -----------------------------------------------------------------------


def _texts(parts: list[Path]) -> Iterator[Any]:
    """The visible text of every page, a part at a time."""
    import pyarrow as pa

    for part in parts:
        yield pa.array(msgspec.msgpack.decode(part.read_bytes())["texts"], pa.string())


def _write_part(
    folder: Path,
    name: str,
    part: Path,
    filters: Sequence[Any],
    score: Callable[[pa.Array], pa.Table] | None,
    verdicts: Verdicts,
) -> None:
    import pyarrow as pa

    from kb.schema import table

    held = msgspec.msgpack.decode(part.read_bytes())
    part.unlink()
    rows = held["rows"]
    if score is not None:
        scores = score(pa.array(held["texts"], pa.string())).to_pylist()
        for row, found in zip(rows["pages"], scores, strict=True):
            row["toxicity"] = max((score for score in found.values() if score is not None), default=None)
    pages = pa.Table.from_pylist(rows["pages"], table("wiki/pages").arrow())
    kept = _judge(pages, filters, verdicts)
    verdicts.kept += len(kept)
    for short in TABLES:
        held_rows = [row for row in rows[short] if row["page_id"] in kept]
        verdicts.rows[f"wiki/{short}"] += len(held_rows)
        _write(folder / short / name, f"wiki/{short}", held_rows)


def _judge(pages: pa.Table, filters: Sequence[Any], verdicts: Verdicts) -> set[int]:
    """The ids of the pages that pass; the first filter that drops a page names its reason."""
    left = set(pages["page_id"].to_pylist())
    for filter_ in filters:
        found = filter_.judge(pages)
        answers = zip(pages["page_id"].to_pylist(), found.reason.to_pylist(), found.value.to_pylist(), strict=True)
        for key, reason, value in answers:
            if key in left and reason is not None:
                verdicts.reject(key, filter_.stage, reason, value, found.threshold)
                left.discard(key)
    return left
