"""README.md: the dataset card, with the front matter that Hugging Face's loader and hub read.

Source: "Dataset Cards" and "Manual configuration" in the Hugging Face hub documentation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.release.about import ABOUT
from kb.release.licences import licence
from kb.release.texts import (
    SANDBOX_NOTE,
    bibtex,
    day,
    folded,
    language,
    rows,
    size,
    span,
    summary,
    title,
    value,
)

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.release.measure import Facts, TableFacts

_SIZES = (
    (10**3, "n<1K"),
    (10**4, "1K<n<10K"),
    (10**5, "10K<n<100K"),
    (10**6, "100K<n<1M"),
    (10**7, "1M<n<10M"),
    (10**8, "10M<n<100M"),
)


def card(run: Run, facts: Facts) -> str:
    """The whole card."""
    about, section = ABOUT[facts.source], run.profile.release
    law = licence(facts.licence)
    parts = [
        _front(run, facts),
        f"# {title(run, facts)}\n\n{summary(run, facts)}\n",
        f"> **{SANDBOX_NOTE}**\n" if facts.sandbox else "",
        rows(
            ("", ""),
            [
                ("Version", section.version),
                ("Built", day(facts.built)),
                ("Read from the source", span(facts.read)),
                ("Material from", span(facts.made)),
                ("Rows", f"{facts.rows:,}"),
                ("Size", size(facts.size)),
                ("Licence", f"[{law.title}]({law.url})"),
                ("Removed since collection", f"{facts.tombstones:,} (tombstones.parquet)"),
            ],
        ),
        "## Tables\n",
        *[_table(table) for table in facts.tables],
        _others(facts),
        _use(facts),
        "## How it was made\n\n"
        + about.on(run.profile.title, about.collection)
        + "\n\n"
        + "".join(f"- {line}\n" for line in about.processing),
        _dropped(facts),
        "## Limits\n\n"
        + "".join(
            f"- {line}\n" for line in (*about.biases, *about.limits, about.absent, *facts.gaps)
        ),
        "## People and removal\n\n"
        + about.people
        + "\n\n"
        + about.upkeep
        + f"\n\nTo have something removed, write to {contact(run)}.\n",
        (
            f"## Licence and credit\n\n{about.attribution}\n\n{law.title} ({law.spdx}): {law.short} The full text is in LICENSE.\n"
        ),
        (
            f"## Citation\n\n```bibtex\n{bibtex(run, facts)}\n```\n\nCITATION.cff says the same for machines; "
            "DATASHEET.md answers the questions of *Datasheets for Datasets*.\n"
        ),
    ]
    return "\n".join(part for part in parts if part)


def contact(run: Run) -> str:
    """Where removal requests go."""
    section = run.profile.release
    return section.contact or section.homepage or "the depositor of this record"


def _front(run: Run, facts: Facts) -> str:
    about = ABOUT[facts.source]
    category = next((word for limit, word in _SIZES if facts.rows < limit), "n>100M")
    words = [run.profile.name, *about.words, *run.profile.release.keywords]
    lines = [
        "---",
        f"license: {licence(facts.licence).hugging_face}",
        f"pretty_name: {folded(title(run, facts))}",
    ]
    lines += [
        "language:",
        f"- {language(run)}",
        "size_categories:",
        f"- {category}",
    ]
    lines += ["task_categories:", *[f"- {task}" for task in about.tasks]]
    lines += ["tags:", *[f"- {folded(word)}" for word in dict.fromkeys(words)], "configs:"]
    for index, table in enumerate(facts.tables):
        short = table.table.short
        lines += [f"- config_name: {short}"] + (
            ["  default: true"] if index == _main(facts) else []
        )
        lines += ["  data_files:", "  - split: train", f'    path: "{short}-*-of-*.parquet"']
    return "\n".join([*lines, "---", ""])


def _main(facts: Facts) -> int:
    """The table that a reader means who names none."""
    names = [table.table.short for table in facts.tables]
    return next(
        (names.index(name) for name in ("videos", "pages", "posts", "pairs") if name in names), 0
    )


def _table(table: TableFacts) -> str:
    head = (
        f"### {table.table.short}\n\n{table.table.doc} {table.rows:,} rows, {size(table.size)} in {len(table.files)} "
        f"{'file' if len(table.files) == 1 else 'files'};"
    )
    head += f" sorted by {', '.join(table.table.sort_by)}; key {', '.join(table.table.key)}.\n"
    lines = []
    for fact in table.columns:
        column = fact.column
        doc = column.doc + (
            f" Null: {column.why_null} ({fact.nulls:,} of {table.rows:,})."
            if column.nullable
            else ""
        )
        if fact.top:
            values = ", ".join(f"{name} {n:,}" for name, n in fact.top)
        else:
            values = " – ".join(
                dict.fromkeys(
                    value(thing)
                    for thing in (fact.low, fact.middle, fact.high)
                    if thing is not None
                )
            )
        lines.append((f"`{column.name}`", column.type, column.unit, doc, values))
    return (
        head
        + "\n"
        + rows(
            (
                "column",
                "type",
                "unit",
                "what it is",
                "smallest – median – largest, or most frequent",
            ),
            lines,
        )
    )


def _others(facts: Facts) -> str:
    if not facts.others:
        return ""
    head = "Path columns read `<tar>/<member>`: the file `<member>` inside the archive `<tar>` of this folder.\n\n"
    return (
        "### Archives\n\n"
        + head
        + rows(("file", "size"), [(f"`{file.name}`", size(file.size)) for file in facts.others])
    )


def _use(facts: Facts) -> str:
    short = facts.tables[_main(facts)].table.short
    return f"""## Use

```sh
sha256sum -c SHA256SUMS                      # nothing was lost on the way
```
```sql
SELECT count(*) FROM read_parquet('{short}-*-of-*.parquet');   -- DuckDB
```
```python
import datasets, mlcroissant, polars, pyarrow.dataset

datasets.load_dataset("THIS_FOLDER", "{short}", split="train")
polars.read_parquet("THIS_FOLDER/{short}-*-of-*.parquet")
pyarrow.dataset.dataset("THIS_FOLDER/{facts.tables[_main(facts)].files[0].name}").to_table()
mlcroissant.Dataset("THIS_FOLDER/croissant.json").records("{short}")
```

`sample-*.parquet` holds a few rows of each table that belong together, for a first look.
"""


def _dropped(facts: Facts) -> str:
    if not facts.rejected:
        return ""
    stages: dict[str, int] = {}
    for stage, _, n in facts.rejected:
        stages[stage] = stages.get(stage, 0) + n
    lines = [
        (stage, f"{n:,}")
        for stage, n in sorted(stages.items(), key=lambda item: (-item[1], item[0]))
    ]
    return "\nWhat the filters dropped:\n\n" + rows(("stage", "rows"), lines)
