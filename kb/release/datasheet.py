"""DATASHEET.md: the questions of "Datasheets for Datasets" (Gebru et al., 2021), answered from the data.

Figures come from kb.release.measure, sentences from kb.release.about; no answer is written by hand
for one release.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.release.about import ABOUT
from kb.release.card import contact
from kb.release.licences import licence
from kb.release.texts import SANDBOX_NOTE, day, rows, size, span, summary, title

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.release.measure import Facts


def datasheet(run: Run, facts: Facts) -> str:
    """The whole datasheet."""
    parts = [
        f"# Datasheet: {title(run, facts)}\n",
        (
            f"Version {run.profile.release.version}, built {day(facts.built)}. Every figure here was measured on the data of this folder.\n"
        ),
    ]
    if facts.sandbox:
        parts.append(f"> **{SANDBOX_NOTE}**\n")
    for heading, questions in _sections(run, facts):
        parts.append(f"## {heading}\n")
        parts += [f"**{question}**\n\n{answer.strip()}\n" for question, answer in questions]
    return "\n".join(parts)


def _sections(run: Run, facts: Facts) -> list[tuple[str, list[tuple[str, str]]]]:
    about, law = ABOUT[facts.source], licence(facts.licence)
    who = ", ".join(
        one.name + (f" ({one.affiliation})" if one.affiliation else "")
        for one in run.profile.release.creators
    )
    rejected = sum(n for _, _, n in facts.rejected)
    kept = next(
        (
            table.rows
            for table in facts.tables
            if table.table.short in ("videos", "pages", "posts", "pairs")
        ),
        facts.rows,
    )
    return [
        (
            "Motivation",
            [
                (
                    "For what purpose was the dataset created?",
                    (
                        f"For research on agents and models that learn from what people publish about {run.profile.title}. Uses in mind: "
                    )
                    + "; ".join(about.uses)
                    + ".",
                ),
                ("Who created the dataset?", f"{who}, with the open pipeline Lorebase."),
            ],
        ),
        (
            "Composition",
            [
                ("What do the instances represent?", about.instance.capitalize() + "."),
                (
                    "How many instances are there?",
                    rows(
                        ("table", "rows", "files", "size"),
                        [
                            (t.table.short, f"{t.rows:,}", len(t.files), size(t.size))
                            for t in facts.tables
                        ],
                    ),
                ),
                (
                    "Is it a sample of a larger set?",
                    (
                        f"{kept:,} were kept, {rejected:,} dropped by the filters below, {facts.failed:,} could not "
                        f"be had after all tries and {facts.pending:,} still waited when this was built. "
                        f"{about.biases[0]}"
                    ),
                ),
                (
                    "What data does each instance consist of?",
                    "The columns of README.md, each with type, unit and origin. "
                    + summary(run, facts),
                ),
                ("Is any information missing?", about.absent + "\n\n" + _nulls(facts)),
                (
                    "Are relationships between instances explicit?",
                    "Yes, by the key columns: "
                    + "; ".join(f"{t.table.short} ({', '.join(t.table.key)})" for t in facts.tables)
                    + ".",
                ),
                (
                    "Are there recommended splits?",
                    (
                        "No. Everything is in one split, so that users can split by channel, page or thread and keep near-duplicates together."
                    ),
                ),
                (
                    "Are there errors, noise or redundancies?",
                    " ".join((*about.limits, *facts.gaps))
                    + " Keys are unique; each row is the newest answer for its key.",
                ),
                ("Is the dataset self-contained?", "The tables are. " + about.raw),
                (
                    "Does it contain confidential data?",
                    "No. Only what was public when it was read.",
                ),
                ("Might it be offensive?", _toxicity(run, facts)),
                (
                    "Does it relate to people? Can they be identified?",
                    about.people + "\n\n" + _personal(facts),
                ),
            ],
        ),
        (
            "Collection process",
            [
                ("How was the data acquired?", about.on(run.profile.title, about.collection)),
                (
                    "Over what timeframe?",
                    f"Read from the source: {span(facts.read)}. The material itself is from {span(facts.made)}.",
                ),
                (
                    "Were people notified, did they consent?",
                    (
                        "Not one by one: the material was published by them for everyone. Whoever wants something "
                        "removed can ask for it; see Maintenance."
                    ),
                ),
            ],
        ),
        (
            "Preprocessing, cleaning, labeling",
            [
                (
                    "What was done?",
                    "".join(f"- {line}\n" for line in about.processing) + "\n" + _stages(facts),
                ),
                ("Was the raw data saved?", about.raw),
                (
                    "Is the software available?",
                    "Yes: Lorebase, with the profile and the lock file that it was run with.",
                ),
            ],
        ),
        (
            "Uses",
            [
                ("What could it be used for?", "".join(f"- {line}\n" for line in about.uses)),
                ("What should it not be used for?", "".join(f"- {line}\n" for line in about.avoid)),
                ("What should a user know?", "".join(f"- {line}\n" for line in about.biases)),
            ],
        ),
        (
            "Distribution",
            [
                (
                    "How is it distributed?",
                    f"As Parquet files ({size(facts.size)}) in one deposit, with checksums in SHA256SUMS.",
                ),
                (
                    "Under which licence?",
                    f"{law.title} ({law.spdx}), {law.url}. {about.attribution} {law.short}"
                    + _licences(facts),
                ),
            ],
        ),
        (
            "Maintenance",
            [
                ("Who maintains it, how can they be reached?", f"{who}; {contact(run)}."),
                ("Will it be updated?", about.upkeep),
                (
                    "What of removed instances?",
                    (
                        f"{facts.tombstones:,} keys were removed since collection began; tombstones.parquet names "
                        "them with date and reason, so that copies can follow."
                    ),
                ),
                (
                    "Will older versions be kept?",
                    (
                        "Deposits keep their versions; what was removed for a person's sake is removed from the "
                        "newest, and tombstones ask users to do the same."
                    ),
                ),
            ],
        ),
    ]


def _nulls(facts: Facts) -> str:
    lines = [
        (
            f"{table.table.short}.{fact.column.name}",
            f"{fact.nulls:,} of {table.rows:,}",
            fact.column.why_null,
        )
        for table in facts.tables
        for fact in table.columns
        if fact.nulls
    ]
    return rows(("column", "null", "why"), lines) if lines else "No value is null."


def _stages(facts: Facts) -> str:
    if not facts.rejected:
        return "No row was dropped."
    return rows(
        ("stage", "reason", "dropped"),
        [(stage, reason, f"{n:,}") for stage, reason, n in facts.rejected],
    )


def _toxicity(run: Run, facts: Facts) -> str:
    if facts.source == "pairs":
        return "The index holds no text. Its videos passed the toxicity stage by title and description."
    models = ", ".join(
        f"{model} {revision} in {precision}" for model, revision, precision in facts.models
    )
    if not models:
        return "Texts were not scored."
    threshold = run.profile.toxicity.threshold(facts.source)
    dropped = sum(n for stage, _, n in facts.rejected if stage == "toxicity")
    rule = (
        f"Texts above {threshold:g} in any category were dropped ({dropped:,} rows)."
        if threshold is not None
        else "Scores are kept beside the rows and nothing was dropped for them."
    )
    return f"Texts were scored by Detoxify ({models}). {rule} Words that the model does not know as offensive remain."


def _personal(facts: Facts) -> str:
    if not facts.personal:
        return "The released columns hold no text that people wrote."
    return rows(
        ("text", "rows", "with an e-mail address", "with a phone number"),
        [
            (f"{table}.{column}", *(f"{n:,}" for n in counts))
            for (table, column), counts in facts.personal.items()
        ],
    )


def _licences(facts: Facts) -> str:
    if len(facts.licences) <= 1:
        return ""
    return "\n\nRows name these licences:\n\n" + rows(
        ("licence", "rows"), [(name, f"{n:,}") for name, n in facts.licences]
    )
