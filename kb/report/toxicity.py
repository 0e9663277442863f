"""The toxicity model's scores: what was kept, what was dropped, where the threshold lies."""

from __future__ import annotations

import itertools

from kb.core.profile import Profile
from kb.report.data import ReportData
from kb.report.style import BLUE, GREY, ORANGE, Figure, canvas, number, saved

_EDGES = [step / 20 for step in range(21)]


def toxicity(
    data: ReportData, profile: Profile, table: str, columns: tuple[str, ...]
) -> Figure | None:
    """Rows of a table by the largest score of their texts, on a logarithmic axis of counts."""
    kept, dropped = data.kept_scores(table, columns, _EDGES), data.dropped_scores(table, _EDGES)
    if not sum(kept) + sum(dropped):
        return None
    source, _, rows = table.partition("/")
    threshold = profile.toxicity.threshold(source)
    sheet, axes = canvas(3.1)
    for values, label, color, hatch in (
        (kept, "kept", BLUE, None),
        (dropped, "dropped for it", ORANGE, "////"),
    ):
        if sum(values):
            axes.bar(
                _EDGES[:-1],
                values,
                0.05,
                align="edge",
                color=color,
                hatch=hatch,
                edgecolor="white",
                linewidth=0.6,
                label=label,
            )
    axes.set_yscale("log")
    axes.set_ylim(0.6, max(*kept, *dropped) * 3)
    axes.yaxis.set_major_formatter(lambda value, _: number(value))
    axes.yaxis.minorticks_off()
    axes.set_xlim(0, 1)
    axes.set_xlabel("largest score of the row's texts (0 to 1)")
    axes.set_ylabel(f"{rows} (logarithmic)")
    axes.grid(axis="y")
    if threshold is not None:
        axes.axvline(
            threshold,
            color=GREY,
            linewidth=1.4,
            linestyle=(0, (4, 2)),
            label=f"threshold {threshold:g}",
        )
    sheet.legend(loc="outside upper center", ncols=3, handlelength=1.6, columnspacing=1.2)
    limit = f"dropped above {threshold:g}" if threshold is not None else "none is dropped for it"
    return Figure(
        f"{source}-{rows}-toxicity",
        f"How the model scored the {rows}",
        f"The largest score of a row's texts in any category, {limit}. {sum(kept):,} {rows} kept, "
        f"{sum(dropped):,} dropped; rows without any text have no score.",
        f"Histogram of toxicity scores from 0 to 1: {kept[0]:,} kept {rows} are below 0.05, "
        f"{sum(dropped):,} were dropped.",
        saved(sheet),
        ("score", "kept", "dropped"),
        [
            (f"{low:.2f} to {high:.2f}", a, b)
            for (low, high), a, b in zip(itertools.pairwise(_EDGES), kept, dropped, strict=True)
        ],
    )
