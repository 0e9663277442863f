"""docs/trace.md: a video is followed from its raw line to its released row, and the page names what
it passes.
"""

import hashlib
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.installation import folder
from tests.filters.made import MONDAY, listing, put, transcript, video
from tests.inprocess import Here

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "trace.md").read_text(encoding="utf-8")
ENTRY = re.compile(r"^- \[`([\w.]+)`\]\(\.\./([\w./]+)\): (.+(?:\n  .+)*)$", re.MULTILINE)
FOLLOWED = "followed001"
MOST_CALLS = 9
# Cuts columns out of rows wherever something needs one, but for what finds the newest row.
NOT_A_STOP, NEWEST = "kb/store/tables/columns.py", ("newest", "duplicates")


class Trace:
    """Calls of public functions that hold the followed video, and of those that called them."""

    def __init__(self) -> None:
        self.stops: dict[str, str] = {}  # dotted name → file, in the order of the first call
        self.comparisons: list[list[str]] = []  # the calls that led to each one with min_views
        self._looking = False

    @contextmanager
    def on(self) -> Iterator[None]:
        sys.setprofile(self._seen)
        try:
            yield
        finally:
            sys.setprofile(None)

    def _seen(self, frame: FrameType, event: str, result: Any) -> None:
        if self._looking or event not in ("call", "return") or not stop_of(frame.f_code):
            return
        self._looking = True
        code = frame.f_code
        given = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        arguments = [frame.f_locals.get(name) for name in given]
        try:
            if holds(arguments if event == "call" else result):
                for name, file in calls_to(frame):
                    self.stops.setdefault(name, file)
            compares = event == "call" and code.co_qualname == "AtLeast.judge"
            if compares and arguments[0].setting == "youtube.min_views":
                self.comparisons.append(calls_between("filter_", frame))
        finally:
            self._looking = False


def stop_of(code: CodeType) -> tuple[str, str] | None:
    """The dotted name of a public function of Lorecrawl, and its file. A function inside of another
    one has its name.
    """
    path = Path(code.co_filename)
    file = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else ""
    name = code.co_qualname.split(".<locals>")[0]
    if not file.startswith(("kb/", "pipelines/")):
        return None
    if file == NOT_A_STOP and name not in NEWEST:
        return None
    if any(part.startswith(("_", "<")) for part in name.split(".")):
        return None
    return f"{file.removesuffix('.py').replace('/', '.')}.{name}", file


def calls_to(frame: FrameType | None) -> list[tuple[str, str]]:
    """The public functions that led to a call, the first one first."""
    calls: list[tuple[str, str]] = []
    while frame is not None:
        stop = stop_of(frame.f_code)
        if stop is not None:
            calls.insert(0, stop)
        frame = frame.f_back
    return calls


def calls_between(first: str, last: FrameType) -> list[str]:
    """The calls of Lorecrawl's functions, private ones too, after that of `first`."""
    calls: list[str] = []
    frame: FrameType | None = last
    while frame is not None and not frame.f_code.co_qualname.endswith(f".{first}"):
        if Path(frame.f_code.co_filename).is_relative_to(ROOT / "kb"):
            calls.insert(0, frame.f_code.co_qualname)
        frame = frame.f_back
    assert frame is not None, f"{first} is not among {calls}"
    return calls


def holds(value: Any) -> bool:
    """Whether a raw line, an answer or rows contain the followed video. A single column doesn't."""
    if isinstance(value, bytes):
        return FOLLOWED.encode() in value
    if isinstance(value, (pa.Table, pa.RecordBatch)):
        return FOLLOWED in str(value.to_pydict())
    if isinstance(value, dict):
        inner = value.values()
        return any(map(holds, inner)) if tables_in(value) else FOLLOWED in str(value)
    return isinstance(value, (list, tuple)) and any(map(holds, value))


def tables_in(value: dict[Any, Any]) -> bool:
    return any(isinstance(each, pa.Table) for each in value.values())


@pytest.fixture
def trace(here: Here, tmp_path: Path) -> Trace:
    """One of 50 videos, from its raw line to release/youtube."""
    root = tmp_path / "root"
    ids = (FOLLOWED, *(f"another{number:04}" for number in range(1, 50)))
    # More bytes than the transcripts have, as the largest raw file is read first.
    described = (
        video(key, snippet__description=hashlib.sha512(key.encode()).hexdigest()) for key in ids
    )
    put(root, "videos", (MONDAY, {"id": ",".join(ids)}, listing(*described)))
    put(root, "transcripts", *map(transcript, ids[:2]))
    shutil.copytree(folder("profiles") / "minecraft", tmp_path / "profile")
    profile = tmp_path / "profile" / "profile.toml"
    text = profile.read_text(encoding="utf-8")
    profile.write_text(text.replace('toxicity = "on"', 'toxicity = "off"'), encoding="utf-8")
    here("status", "--data", str(root), "--profile", str(profile))  # which replays the state
    trace = Trace()
    for words in (("filter", "--workers", "1"), ("export",)):
        with trace.on():
            done = here("youtube", *words, "--data", str(root), "--profile", str(profile))
        assert done.code == 0, done.err
    released = pq.read_table(root / "release" / "youtube")["video_id"].to_pylist()
    assert FOLLOWED in released
    return trace


def test_the_page_names_what_a_video_passes(trace: Trace) -> None:
    """In order, each with a sentence and a link to its file. Few calls lie between the command and
    the comparison.
    """
    entries = ENTRY.findall(PAGE)
    assert {name: file for name, file, _ in entries} == trace.stops
    assert [name for name, _, _ in entries] == list(trace.stops)
    assert len(entries) == PAGE.count("\n- ")
    for name, _, sentence in entries:
        assert re.fullmatch(r"[a-z`].+\.", sentence, re.DOTALL), f"{name}: {sentence}"
    assert trace.comparisons
    for calls in trace.comparisons:
        assert len(calls) <= MOST_CALLS, calls
