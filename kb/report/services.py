"""What the services were asked: each on a scale of its own, as their limits are."""

from kb.core.config.profile import Profile
from kb.core.sources import SOURCES
from kb.report.charts import over_time
from kb.report.data import ReportData
from kb.report.figure_style import BLUE, GREEN, GREY, RED, Figure, canvas, saved

_DAYS = 60  # the last ones, when there are more
_COLORS = {"youtube": RED, "wiki": GREEN, "reddit": BLUE}


def quota(data: ReportData, profile: Profile) -> Figure | None:
    """Units of YouTube's quota, or requests of the others, over days; one panel a limit."""
    ledger = data.ledgers()
    if not ledger:
        return None
    days = sorted({day for _, day, _, _, _ in ledger})[-_DAYS:]
    buckets = sorted({(source, bucket) for source, _, bucket, _, _ in ledger})
    in_units = {  # the others' ledgers count a request as a unit
        (source, bucket) for source, _, bucket, _, units in ledger if units and source == "youtube"
    }
    rows = [
        (day, _label(source, bucket), units if (source, bucket) in in_units else requests)
        for source, day, bucket, requests, units in ledger
    ]
    sheet, panels = canvas(0.5 + 1.25 * len(buckets), rows=len(buckets), squeeze=False)
    sums = []
    for index, (place, axes) in enumerate(zip(buckets, panels[:, 0], strict=True)):
        spent = {day: n for day, label, n in rows if label == _label(*place)}
        unit = "units" if place in in_units else "requests"
        last = index == len(buckets) - 1
        over_time(
            days,
            [spent.get(day, 0) for day in days],
            x="day" if last else "",
            y=unit,
            color=_color(place[0]),
            axes=axes,
            labels=4,
        )
        axes.set_title(_title(*place), loc="left", fontsize=10)
        axes.tick_params(axis="x", labelbottom=last)
        axes.yaxis.get_major_locator().set_params(nbins=3)
        sums.append(f"{_title(*place)} {sum(spent.values()):,} {unit}")
    sheet.align_ylabels()
    return Figure(
        "quota",
        "What the services were asked",
        "Spent a day, each service and limit on a scale of its own: units of YouTube's quota, "
        "requests elsewhere.",
        "Bars by day, one panel for each service and limit; in all " + ", ".join(sums) + ".",
        saved(sheet),
        ("day", "bucket", "spent"),
        rows,
    )


def _color(source: str) -> str:
    return _COLORS.get(source, GREY)


def _label(source: str, bucket: str) -> str:
    return source if bucket == source else f"{source} {bucket}"


def _title(source: str, bucket: str) -> str:
    name = SOURCES[source].title if source in SOURCES else source
    return name if bucket in (source, "requests") else f"{name}: {bucket}"
