"""Guides for contributors: their examples run, and what they name is there."""

import csv
import importlib
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.filters.thresholds import thresholds
from kb.report.graph import declared
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table

ROOT = Path(__file__).resolve().parents[2]
GUIDES = ("CONTRIBUTING.md", "schemas/WRITING.md", "docs/architecture.md", "docs/new-source.md")
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example in which a name is defined, as a module."""

    def load(name: str) -> ModuleType:
        blocks = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
        (code,) = [
            block for block in blocks if re.search(rf"^(class|def) {name}\b", block, re.MULTILINE)
        ]
        module = ModuleType("example")
        monkeypatch.setitem(sys.modules, "example", module)
        exec(compile(code, "CONTRIBUTING.md", "exec"), module.__dict__)
        return module

    return load


def test_the_filter_rejects_with_value_and_threshold(example: Any) -> None:
    stage = example("NoLongerThan").NoLongerThan("title", 4, "length")
    judged = stage.judge(pa.table({"title": ["four", "fives", None]}))
    assert judged.reason.to_pylist() == [None, "longer", "absent"]
    assert (judged.value.to_pylist(), judged.threshold) == ([None, "5", None], "4")
    assert stage.reads == {"title"}
    (threshold,) = thresholds([stage])
    assert (threshold.stage, threshold.limit, threshold.at_least) == ("length", 4, False)
    assert threshold.numbers(pa.table({"title": ["four", None]})).to_pylist() == [4, None]


def test_the_export_writes_what_is_kept(example: Any, make_rows: Any, tmp_path: Path) -> None:
    rows = make_rows("youtube/videos", 3)
    write_table(
        Layout(tmp_path).table("youtube/videos") / "part-00000.parquet", rows, "youtube/videos"
    )
    settings = load_settings(dotenv=False, kb_data=tmp_path)
    path = example("write").write(Run(settings, load_profile("minecraft"), tmp_path))
    with path.open(newline="", encoding="utf-8") as file:
        written = list(csv.DictReader(file))
    assert path == Layout(tmp_path).export("csv", "videos.csv")
    wanted = rows.select(["video_id", "title"]).to_pylist()
    assert sorted(written, key=str) == sorted(wanted, key=str)


def test_what_is_named_is_there() -> None:
    """Files, for `<name>` those of each source, and names in modules."""
    text = "\n".join((ROOT / name).read_text() for name in GUIDES)
    for name in set(re.findall(r"`([^`\n]+)`", text)):
        if re.match(r"(kb|tests|schemas|pipelines|data|docs)/", name):
            for source in SOURCES if "<name>" in name else ("",):
                pattern = re.sub(r"<\w+>", "*", name.replace("<name>", source))
                assert list(ROOT.glob(pattern.rstrip("/"))), f"{name}: no {pattern}"
        elif name.startswith("kb."):
            assert resolved(name), f"{name} is not there"


def test_the_page_has_the_graph_as_it_is() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("| artifact | made from |")[2].partition("\n\n")[0].splitlines()[2:]
    rows = [[re.findall(r"`([^`]+)`", cell) for cell in row.split("|")[1:-1]] for row in table]
    assert rows == [
        [[node.artifact], list(node.inputs), [node.recipe], [node.command]]
        for node in declared(load_profile("minecraft"))
    ]
    assert all((ROOT / recipe).is_file() for _, _, (recipe,), _ in rows)


def resolved(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value: Any = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            value = getattr(value, part, None)
        return value is not None
    return False


def test_new_source_shows_the_package_that_is_tested() -> None:
    guide = (ROOT / "docs/new-source.md").read_text(encoding="utf-8")
    shown = re.findall(r"^`([\w./]+)`:\n\n```\w+\n(.*?)\n```$", guide, re.MULTILINE | re.DOTALL)
    assert len(shown) == guide.count("```python") + guide.count("```toml") + guide.count("```json")
    assert len(shown) >= 10
    for name, block in shown:
        text = (ROOT / "tests/fourth/package" / name).read_text(encoding="utf-8")
        assert f"{block}\n" in text, name
