"""Runs steps in processes of their own that are killed before their n-th rename or deletion.

A script, so that nothing has started a thread when it forks:
`python -m tests.crash.killed PLACE STEP=KILLS…` kills each STEP (purge, filter or pairs) at up to
KILLS moments spread over its whole length, purges, and prints a line for each byte left over, then
one for the step: "purge: 12 kills, 0 bad".
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow.parquet as pq
import zstandard

from kb.core.pipeline import load, locate
from kb.export import minedojo, parquet
from kb.filters.clean import run_clean
from kb.pairs.build import build
from kb.store import damage
from tests.filters.made import MONDAY, listing, put, run_at, transcript, video
from tests.forked import import_kb

GONE, OTHER = "AAAAAAAAAA1", "AAAAAAAAAA2"
TRACES = (GONE.encode(), b"marmalade", b"quinquereme")
_CHANGES = {"os.rename", "os.remove", "os.rmdir"}  # before these, what was written lies aside


def make(root: Path) -> None:
    """A data root with the video GONE in every folder, its texts found nowhere else."""
    keys = [GONE, OTHER, *(f"BBBBBBBBB{number:02d}" for number in range(8))]
    put(root, "videos", (MONDAY, {"id": ",".join(keys)}, listing(*map(_video, keys))))
    put(root, "transcripts", *(transcript(key, cues=_cues(key)) for key in keys))
    run = run_at(root)
    run_clean(run, "youtube")
    build(run)
    for write in (
        lambda: parquet.export(run, "youtube"),
        lambda: parquet.export(run, "pairs"),
        lambda: minedojo.youtube(run),
    ):
        write()
    assert traces(root)


def _video(key: str) -> dict[str, object]:
    return video(key, snippet__title="Zanzibar marmalade" if key == GONE else f"Minecraft {key}")


def _cues(key: str) -> list[list[object]]:
    words = "quinquereme of nineveh" if key == GONE else "we dig down a little"
    return [[at * 3, 3, f"{words} and a creeper comes along number {at}"] for at in range(12)]


def purge(root: Path, *keys: str) -> None:
    """`kb purge youtube --ids`."""
    ids = root.parent / f"{root.name}.txt"
    ids.write_text("".join(f"{key}\n" for key in keys))
    load(str(locate("purge", None))).purge(run_at(root), "youtube", ids)


STEPS: dict[str, Callable[[Path], object]] = {
    "purge": lambda root: purge(root, GONE),
    "filter": lambda root: run_clean(run_at(root), "youtube"),
    "pairs": lambda root: build(replace(run_at(root), again=True)),
}


def forked(step: Callable[[], object], kill_before: int = 0) -> tuple[int, int]:
    """Run a step in a process of its own: its wait status, and how many file operations it made."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        count = 0

        def look(event: str, args: tuple[object, ...]) -> None:
            nonlocal count
            if event in _CHANGES:
                count += 1
                if count == kill_before:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(look)
        code = 0
        try:
            step()
        except BaseException:  # noqa: BLE001  the process ends here
            traceback.print_exc()
            code = 1
        os.write(write, str(count).encode())
        os._exit(code)
    os.close(write)
    status = os.waitpid(child, 0)[1]
    said = os.read(read, 32)
    os.close(read)
    return status, int(said or 0)


def traces(root: Path) -> list[str]:
    """Every file whose bytes, decompressed, still hold something of GONE; tombstones name it."""
    found = []
    for path in sorted(root.rglob("*")):
        if path.is_file() and not path.name.startswith("tombstones"):
            for trace in TRACES:
                if any(trace in data for data in _contents(path)):
                    found.append(f"{path.relative_to(root)} holds {trace.decode()}")
    return found


def _contents(path: Path) -> Iterator[bytes]:
    data = path.read_bytes()
    yield data
    if data[:4] == b"PAR1" and data[-4:] == b"PAR1":
        yield repr(pq.read_table(path, partitioning=None).to_pylist()).encode()
    for match in re.finditer(re.escape(b"\x28\xb5\x2f\xfd"), data):
        try:
            yield zstandard.ZstdDecompressor().decompressobj().decompress(data[match.start() :])
        except zstandard.ZstdError:
            continue


def main(place: Path, *steps: str) -> None:
    """Each step, from the same data root."""
    import_kb()  # once, and not in each process
    base = place / "base"
    status, _ = forked(lambda: make(base))
    assert status == 0
    for words in steps:
        step, _, kills = words.partition("=")
        _try(step, int(kills), base, place / step)


def _try(step: str, kills: int, base: Path, place: Path) -> None:
    """Kill one step again and again, each time in a copy of `base`; then look at what is left.

    One process purges them all: what is killed is the step, and a purge alone takes as long to
    warm up as for its work.
    """
    place.mkdir()
    status, length = forked(lambda: STEPS[step](shutil.copytree(base, place / "whole")))
    assert status == 0
    bad, roots = 0, []
    moments = sorted({1 + number * length // kills for number in range(kills)})
    for moment in moments:
        roots.append(shutil.copytree(base, place / f"{moment}-of-{length}"))
        status, _ = forked(partial(STEPS[step], roots[-1]), moment)
        if os.WTERMSIG(status) != signal.SIGKILL:
            print(f"before operation {moment}: ended with {status}")
            bad += 1
    told = place / "told.txt"
    status, _ = forked(lambda: told.write_text("".join(_looked(step, root) for root in roots)))
    assert status == 0
    print(told.read_text(), end="")
    bad += len(told.read_text().splitlines())
    print(f"{step}: {len(moments)} kills, {bad} bad")


def _looked(step: str, root: Path) -> str:
    """Purge a root that `step` was killed in; "", or a line of what is wrong."""
    # A purge that was killed before its list was written has promised nothing.
    begun = step == "purge" and (root / "state" / "youtube.purge.json").exists()
    try:
        purge(root, *([OTHER] if begun else [OTHER, GONE]))
    except (Exception, SystemExit) as error:  # noqa: BLE001  told, and the others are looked at
        return f"{step} killed before operation {root.name}: {error!r}\n"
    left = traces(root)
    left += [str(path) for path in root.rglob(".*") if path.name != ".gitkeep"]
    left += [str(path) for path in damage.asides(root, "youtube")]
    return f"{step} killed before operation {root.name}: {left}\n" if left else ""


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
