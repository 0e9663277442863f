"""The funnel agrees with the filter's own summary."""

import json
import re
from pathlib import Path

from tests.explore.conftest import Explored


def test_rows_by_verdict_and_stage_are_the_filters(demo_pages: Explored, demo: Path) -> None:
    text = demo_pages.ask("/").text
    for source in ("youtube", "wiki", "reddit"):
        path = demo / "data" / "demo" / "clean" / source / "summary.json"
        summary = json.loads(path.read_text())
        section = text.partition(f'id="of-{source}"')[2].partition("</section>")[0]
        shown = {
            verdict: int(n.replace(",", ""))
            for n, verdict in re.findall(r">([\d,]+) (kept|rejected|failed|pending)<", section)
        }
        assert shown == {
            verdict: sum(one[verdict] for one in summary["tally"].values()) for verdict in shown
        }
        dropped = re.findall(r"stage=(\w+)\">([\d,]+)<", section)
        assert {stage: int(n.replace(",", "")) for stage, n in dropped} == summary["stages"]
        last = re.findall(r'<td class="n">([\d,]+)</td>', section)[-1]
        assert int(last.replace(",", "")) == shown["kept"]
