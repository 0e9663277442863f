"""What the shipped recipes do, for tests of a room: the room's function with the registry."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.registry import PUBLISHED
from kb.release import build as release_build
from kb.report import build as report_build


def release(run: Run, only: Sequence[str] = ()) -> Summary:
    """As pipelines/release.py."""
    return release_build.release(run, PUBLISHED, only)


def report(run: Run, out: Path | None = None, figures: bool = False) -> Summary:
    """As pipelines/report.py."""
    return report_build.report(run, PUBLISHED, out, figures)


def export(run: Run, name: str, layout: str = "parquet", **options: Any) -> Summary:
    """As pipelines/source.py."""
    return layouts.export(run, PUBLISHED[name], layout, **options)
