"""Walk one value through commands: every function of kb/ and pipelines/ whose arguments or result
hold it, in the order in which it first comes there.

    kb sandbox --channels 2 --videos 24 -- python -m tests.bench.walk VIDEO_ID \
        "youtube crawl --data D --workers 1" "youtube filter --data D --workers 1" \
        "youtube export --data D"

Prints a line for each stop, and how many functions and files they are. One worker, so that all
of it runs in this process.
"""

import shlex
import sys
import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec
import pyarrow as pa

from kb.cli import main

ROOT = Path(__file__).resolve().parents[2]
PLACES = (f"{ROOT}/kb/", f"{ROOT}/pipelines/")
LEFT_OUT = f"{ROOT}/kb/sandbox/"
MOST = 30_000  # calls of one function that are looked at
ENTRIES = 3_000  # of one collection

Stop = tuple[str, str, str]  # command, file, function


class Walk:
    """`stops` so far; a call of it is what sys.setprofile takes."""

    def __init__(self, value: str) -> None:
        self.command = ""
        self.stops: dict[tuple[str, str], Stop] = {}
        self._value, self._bytes = value, value.encode()
        self._calls: Counter[tuple[str, str]] = Counter()
        self._looking = threading.local()

    def __call__(self, frame: FrameType, event: str, answer: Any) -> None:
        code = frame.f_code
        name = code.co_filename
        if event not in ("call", "return") or not name.startswith(PLACES):
            return
        # Comprehensions and lambdas are parts of the function around them.
        if name.startswith(LEFT_OUT) or "<" in code.co_name:
            return
        place = (name.removeprefix(f"{ROOT}/"), code.co_qualname)
        self._calls[place] += 1
        busy = getattr(self._looking, "busy", False)
        if place in self.stops or busy or self._calls[place] > MOST:
            return
        self._looking.busy = True
        try:
            given = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            values = [frame.f_locals.get(one) for one in given if one not in ("self", "cls")]
            if any(self._holds(one, 4) for one in (values if event == "call" else [answer])):
                self.stops[place] = (self.command, *place)
        finally:
            self._looking.busy = False

    def _holds(self, value: Any, depth: int) -> bool:
        if isinstance(value, str):
            return self._value in value
        if isinstance(value, (bytes, bytearray)):
            return self._bytes in value
        if isinstance(value, (pa.Table, pa.RecordBatch)):
            return any(self._value in str(column.to_pylist()) for column in value.columns)
        if isinstance(value, (pa.Array, pa.ChunkedArray)):
            return self._value in str(value.to_pylist())
        if depth == 0:
            return False
        inner: list[Any] = []
        if isinstance(value, Mapping):
            inner = [*list(value.keys())[:ENTRIES], *list(value.values())[:ENTRIES]]
        elif isinstance(value, (list, tuple, set, frozenset)):
            inner = list(value)[:ENTRIES]
        elif isinstance(value, msgspec.Struct):
            inner = [getattr(value, name, None) for name in value.__struct_fields__]
        elif is_dataclass(value) and not isinstance(value, type):
            inner = [getattr(value, field.name, None) for field in fields(value)]
        return any(self._holds(one, depth - 1) for one in inner)


def run(value: str, commands: list[str]) -> list[Stop]:
    """The stops of a value on its way through commands of `kb`."""
    walk = Walk(value)
    threading.setprofile(walk)
    for command in commands:
        words = shlex.split(command)
        walk.command = " ".join(words[:2])
        sys.setprofile(walk)
        try:
            main(words)
        except SystemExit as ended:
            if ended.code:
                raise
        finally:
            sys.setprofile(None)
    return list(walk.stops.values())


if __name__ == "__main__":
    found = run(sys.argv[1], sys.argv[2:])
    for stop in found:
        print(*stop, sep="\t")
    print(f"{len(found)} functions in {len({file for _, file, _ in found})} files")
