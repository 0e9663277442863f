"""Exports of Label Studio as people would make them from a project of `kb label export`."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from kb.labels.export import TASKS

START = datetime(2026, 11, 1, 12, tzinfo=UTC)


def items(project: Path) -> list[dict[str, Any]]:
    """`data` of each task of a project."""
    return [one["data"] for one in json.loads((project / TASKS).read_text())]


def judgement(person: Any, minutes: float = 0, skipped: bool = False, **answers: Any) -> dict:
    """An annotation as Label Studio 1.23 exports it."""
    result = []
    for name, value in answers.items():
        kind = {str: "choices", float: "number", list: "textarea"}[type(value)]
        field = {"choices": "choices", "number": "number", "textarea": "text"}[kind]
        result.append(
            {
                "id": f"r{len(result)}",
                "from_name": name,
                "to_name": "clip",
                "type": kind,
                "origin": "manual",
                "value": {field: [value] if isinstance(value, str) else value},
            }
        )
    at = (START + timedelta(minutes=minutes)).isoformat().replace("+00:00", "Z")
    return {
        "id": 1,
        "completed_by": person,
        "was_cancelled": skipped,
        "ground_truth": False,
        "created_at": at,
        "updated_at": at,
        "lead_time": 12.5,
        "result": result,
    }


def exported(path: Path, tasks: Iterable[tuple[dict[str, Any], list[dict[str, Any]]]]) -> Path:
    """A JSON export with these items and their judgements."""
    rows = [
        {"id": number, "data": data, "annotations": made, "predictions": [], "drafts": []}
        for number, (data, made) in enumerate(tasks, start=1)
    ]
    path.write_text(json.dumps(rows))
    return path
