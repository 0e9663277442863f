"""Fault injection over every command that writes: killed before any of its file operations, joined
by a second one while it stands still, and given damaged files.

`make chaos` prints tables and ends with 1 when something was lost, leaked, left over or silent:

    KB_CHAOS_KILLS=50 a command, KB_CHAOS_FLIPS=2000, KB_CHAOS_DAMAGES=5 of each kind at each place,
    KB_CHAOS_AT_ONCE commands, SEED=14, ONLY=command,command
    KB_CHAOS_LOG=FILE gets a line of JSON for each moment of harm: it takes hours, and so it is
    known what was tried by a run that was stopped

`make test` has a sample of it in tests/crash/test_chaos.py.

After each kill the same command is run again. Then the folders that it makes have the bytes of an
unharmed run, no leftover and no file more than there is in the folder, `kb verify` finds nothing,
and of what was purged no byte is anywhere.
"""

import json
import os
import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import duckdb
import pyarrow.parquet as pq
import zstandard

from kb.core.errors import FatalError, KbError
from kb.core.progress import Progress
from kb.store import leftovers
from kb.verify.root import verify
from tests.crash import damaged, harm, worlds
from tests.crash.worlds import Case, Worlds
from tests.filters.made import digests
from tests.services.zenodo import Deposition
from tests.store import flips

# How many answers it took, which a killed refresh asks for twice; how many requests and writes.
_COUNTS = ("summary.json", ".done.json")
# What it was made of: a crawl that was killed leaves the same answers in more segments.
_INPUTS = "_manifest.json"
_SETTLES = (".sqlite-wal", ".sqlite-shm")


def tables(folder: Path) -> dict[str, str]:
    """The rows of each table below a folder, in one digest each, in however many parts they lie.

    What is restored is added to, so its parts say in how many goes that was done.
    """
    found = {}
    with duckdb.connect() as con:
        for place in sorted({path.parent for path in folder.rglob("*.parquet")}):
            row = con.execute(
                "SELECT sha256(string_agg(row::VARCHAR, chr(10) ORDER BY row::VARCHAR))"
                " FROM read_parquet(?) AS row",
                [f"{place}/*.parquet"],
            ).fetchone()
            found[str(place.relative_to(folder))] = str(row)
    return found


def noted(**what: Any) -> None:
    """A line of the log, for a run that is stopped before its tables."""
    if place := os.environ.get("KB_CHAOS_LOG"):
        with Path(place).open("a", encoding="utf-8") as file:
            file.write(json.dumps(what) + "\n")


class Outcome(NamedTuple):
    """What a run left: bytes by path, every path outside of raw/, of all paths those that should
    have gone again, and what `kb verify` said.
    """

    bytes: dict[str, str]
    paths: frozenset[str]
    left: tuple[str, ...]
    verified: tuple[str, ...]


class Result:
    """What happened to one command."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.counts: Counter[str] = Counter()
        self.said: list[str] = []

    def add(self, moment: str, wrong: list[tuple[str, str]]) -> None:
        """A moment of harm, and (kind, what) of everything that was not right after it."""
        noted(command=self.case.name, moment=moment, wrong=wrong)
        self.counts["kills"] += 1
        self.counts["right"] += not wrong
        for kind in {kind for kind, _ in wrong}:
            self.counts[kind] += 1
        self.said += [f"{self.case.name}, {moment}: {kind}: {what}" for kind, what in wrong]


class Trial:
    """One command, in a folder of its own."""

    def __init__(self, made: Worlds, case: Case, place: Path) -> None:
        self.made, self.case, self.place = made, case, place
        self.root = place / "data"
        self.env = made.env | {"KB_DATA": str(self.root)} | case.env
        self._publishes = "publish" in case.words
        service: Any = made.sandbox.applications["zenodo"]
        self._deposits: dict[int, Deposition] = service.by_id

    def whole(self, base: str) -> tuple[Outcome, int]:
        """What an unharmed run leaves, and how many file operations it makes."""
        if (self.case.words, base) not in self.made.wholes:
            self.fresh(base)
            if self.case.gone:
                assert leaked(self.root, self.case.gone), "what is purged is there"
            ended = self.run()
            assert ended.code == 0, (self.case.words, ended.err[-2000:])
            self.shown()
            whole = self.outcome()
            self.made.wholes[self.case.words, base] = whole, ended.operations
            assert not whole.verified, whole.verified
            wrong = self.wrong(base, now=whole)
            assert not wrong, wrong
        return self.made.wholes[self.case.words, base]

    def fresh(self, base: str) -> None:
        """A copy of a base."""
        shutil.rmtree(self.place, ignore_errors=True)
        if self._publishes:
            self._deposits.clear()
        shutil.copytree(self.made.base(base), self.root, symlinks=True)

    def run(self, kind: str = "", before: int = 0, at: str = "", largest: int = 0) -> harm.Ended:
        """The command, harmed or not."""
        how = {"harm": kind, "before": before, "at": at, "largest": largest}
        return harm.run(self.case.words, self.env, self.place, **how)

    def shown(self) -> list[tuple[str, str]]:
        """Run what makes visible what the command did."""
        wrong = []
        for words in self.case.then:
            ended = harm.run(words, self.env, self.place)
            if ended.code:
                wrong.append(("lost", f"then {words} ended with {ended.code}: {_last(ended)}"))
        return wrong

    def again(self) -> list[tuple[str, str]]:
        """The same command once more, as a user would type it."""
        ended, finished = self.run(), self.case.finished
        if ended.code and not (finished and finished in ended.err):
            return [("lost", f"again: exit code {ended.code}: {_last(ended)}")]
        return self.shown()

    def outcome(self) -> Outcome:
        """What is there now."""
        held = {
            f"{folder}/{name}": digest
            for folder in self.case.same
            for name, digest in (tables if folder == "restored" else digests)(
                self.root / folder
            ).items()
            if not name.endswith((_INPUTS, *_COUNTS[self.case.words[0] != "refresh" :]))
        }
        paths = [path.relative_to(self.root) for path in self.root.rglob("*")]
        return Outcome(
            held,
            frozenset(
                str(path)
                for path in paths
                if path.parts[0] not in ("raw", "index")  # whose files have random names
                and path.parts[:2] != ("state", "runs")  # each run that ends leaves one
                and not path.name.endswith(_SETTLES)
                and not (path.parts[0] == "restored" and path.suffix == ".parquet")
            ),
            tuple(str(path) for path in paths if _is_left(path)),
            tuple(found(self.root)),
        )

    def wrong(
        self, base: str, twice: bool = False, now: Outcome | None = None
    ) -> list[tuple[str, str]]:
        """(kind, what) of everything that differs from an unharmed run; `now` is what is there.

        `twice`: it ran to its end two times, and a summary counts what the last one found.
        """
        whole, now = self.whole(base)[0], now or self.outcome()
        differ = sorted(
            name
            for name in whole.bytes.keys() | now.bytes.keys()
            if whole.bytes.get(name) != now.bytes.get(name)
            and not (twice and name.endswith("summary.json"))
        )
        wrong = [("lost", f"not as unharmed: {differ[:5]}")] if differ else []
        wrong += [("lost", what) for what in now.verified if what not in whole.verified]
        more = sorted(now.paths - whole.paths)
        aside = "--repair" in self.case.words  # it sets aside what is damaged, for good
        more += [name for name in now.left if not (aside and ".damaged" in Path(name).name)]
        wrong += [("left over", str(sorted(set(more))[:5]))] if more else []
        wrong += self._published() if self._publishes else []
        return wrong + [("leaked", what) for what in leaked(self.root, self.case.gone)]

    def _published(self) -> list[tuple[str, str]]:
        """Each folder is one public record with the folder's files, and there is nothing else."""
        folders = [path for path in (self.root / "release").iterdir() if path.is_dir()]
        wanted = [{one.name: one.read_bytes() for one in path.iterdir()} for path in folders]
        there = [one.files for one in self._deposits.values() if one.submitted]
        wrong = [] if all(one in there for one in wanted) else [("lost", "a folder has no record")]
        more = len(self._deposits) - len(folders)
        return wrong + ([("left over", f"{more} deposits more than folders")] if more else [])

    def kill(self, base: str, before: int, kind: str) -> tuple[str, list[tuple[str, str]]]:
        """Kill, run again, look: (the moment, what is wrong); no moment: it had ended before."""
        self.whole(base)
        self.fresh(base)
        ended = self.run(kind, before)
        if ended.code != -9:
            why = [("lost", f"ended with {ended.code}: {_last(ended)}")] if ended.code else []
            return "", why
        return f"{base}, {ended.moment}", self.again() or self.wrong(base)

    def join(self, base: str, before: int) -> tuple[str, list[tuple[str, str]]]:
        """A second one while the first stands still: both right, or one line with its pid."""
        self.whole(base)
        self.fresh(base)
        child = harm.HarmedProcess(self.case.words, self.env, self.place, harm.PAUSE, before)
        if not child.has_stopped():
            child.end()
            return "", []
        other = harm.HarmedProcess(self.case.words, self.env, self.place)
        # It may wait, where the first decides something in a moment (kb.store.lock.deciding).
        other.ends_within(4)
        child.resume()
        first, second = child.end(), other.end()
        moment = f"{base}, joined at {first.moment}"
        wrong = []
        # Between taking a lock and writing the number it is another process (pid unknown).
        said = self.case.finished or "another process (pid "
        if second.code and said not in second.err:
            wrong.append(("lost", f"the second: {second.code}: {_last(second)}"))
        if first.code and second.code:
            wrong.append(("lost", f"the first: {first.code}: {_last(first)}"))
        if first.code and "Traceback" in first.err + second.err:
            wrong.append(("lost", "a traceback"))
        wrong = wrong or self.shown() or self.wrong(base, twice=not (first.code or second.code))
        return moment, wrong


def told(trial: Trial, count: int, seed: int, joins: int) -> Result:
    """As `kills`; a command that can't be tried is told, and the others go on."""
    try:
        return kills(trial, count, seed, joins)
    except (AssertionError, OSError) as error:
        result = Result(trial.case)
        result.add("unharmed", [("lost", f"{type(error).__name__}: {error}")])
        return result


def kills(trial: Trial, count: int, seed: int, joins: int = 0) -> Result:
    """A command killed `count` times at moments spread over its whole length, drawn by `seed`."""
    result, case = Result(trial.case), trial.case
    draw = random.Random(f"{seed} {case.name}")
    for base_number, base in enumerate(case.bases):
        share = len(range(base_number, count, len(case.bases)))
        length = trial.whole(base)[1] if share else 0
        for before in _spread(length, share, draw):
            kind = draw.choice((harm.KILL, harm.TEAR))
            moment, wrong = trial.kill(base, before, kind)
            if moment or wrong:
                result.add(moment, wrong)
    for number in range(joins):
        base = case.bases[number % len(case.bases)]
        moment, wrong = trial.join(base, draw.randrange(1, trial.whole(base)[1] + 1))
        if moment:
            result.add(moment, wrong)
            result.counts["kills"] -= 1
            result.counts["right"] -= not wrong
            result.counts["joined"] += 1
    return result


def _spread(length: int, count: int, draw: random.Random) -> Iterator[int]:
    """`count` moments of 1 … length, one in each part of it; again where it has fewer."""
    for number in range(count):
        low = 1 + number * length // count
        yield draw.randrange(low, max(low + 1, 1 + (number + 1) * length // count))


def found(root: Path) -> list[str]:
    """What `kb verify` finds."""
    try:
        look = verify(root, Progress())
    except KbError as error:  # an empty folder is no data root
        return [] if type(error) is FatalError else [str(error)]
    return [f"{one.state}: {one.path.relative_to(root)}: {one.what}" for one in look.entries]


def leaked(root: Path, traces: Sequence[bytes]) -> list[str]:
    """Files whose bytes, decompressed, hold what was purged; tombstones name keys."""
    paths = [path for path in sorted(root.rglob("*")) if path.is_file()] if traces else []
    return [
        f"{path.relative_to(root)} holds {trace!r}"
        for path in paths
        if not path.name.startswith("tombstones")
        for trace in traces
        if any(trace in data for data in _contents(path))
    ]


def _contents(path: Path) -> Iterator[bytes]:
    """The bytes of a file, and what they hold in compressed form."""
    data = path.read_bytes()
    yield data
    if data[:4] == b"PAR1" and data[-4:] == b"PAR1":
        yield repr(pq.read_table(path, partitioning=None).to_pylist()).encode()
    for match in re.finditer(re.escape(b"\x28\xb5\x2f\xfd"), data):
        try:
            yield zstandard.ZstdDecompressor().decompressobj().decompress(data[match.start() :])
        except zstandard.ZstdError:
            continue


def _is_left(path: Path) -> bool:
    endings = (".tmp", ".new", ".old", ".lease", ".part", ".damaged")
    name = path.name
    return leftovers.is_left(path.parts) or name.endswith(endings) or ".damaged-" in name


def _last(ended: harm.Ended) -> str:
    return next((line for line in ended.err.splitlines() if line.startswith("kb: ")), ended.err)


def chosen(made: Worlds, only: str) -> list[Case]:
    """The cases whose command begins with one of these words, which commas part; all for none."""
    words = tuple(word.strip() for word in only.split(","))
    return [case for case in made.cases if case.name.startswith(words)]


def table(head: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    """Columns side by side."""
    cells = [[str(cell) for cell in line] for line in (head, *lines)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if number == 0 else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in cells
    )


def main() -> int:
    """Everything, as long as asked for; 1 when something is wrong."""
    count = int(os.environ.get("KB_CHAOS_KILLS") or 50)
    changed = int(os.environ.get("KB_CHAOS_FLIPS") or 2_000)
    seed, only = int(os.environ.get("SEED") or 14), os.environ.get("ONLY") or ""
    sandbox, wiki = worlds.services()
    with tempfile.TemporaryDirectory(prefix="kb-chaos-") as name, sandbox:
        place = Path(name)
        made = Worlds(place / "made", sandbox, wiki)
        if not wiki:
            print("no browser: the wiki's commands are left out")
        cases, done = sorted(chosen(made, only), key=lambda case: case.slow), []
        at_once = int(os.environ.get("KB_CHAOS_AT_ONCE") or os.cpu_count() or 1)
        with ThreadPoolExecutor(at_once) as pool:
            started = [
                pool.submit(
                    partial(
                        told,
                        Trial(made, case, place / f"trial-{number}"),
                        count,
                        seed,
                        joins=1 + (count >= 20),
                    )
                )
                for number, case in enumerate(cases)
            ]
            for one in as_completed(started):
                done.append(one.result())
                print(f"{done[-1].case.name}: {dict(done[-1].counts)}", flush=True)
                print("\n".join(done[-1].said), flush=True)
        kinds = ("kills", "right", "joined", "lost", "leaked", "left over")
        lines = [[one.case.name, *(one.counts[kind] for kind in kinds)] for one in done]
        print(table(("command", "kills", "right again", *kinds[2:]), lines))
        bad = any(one.said for one in done)
        if not only:
            counts, silent = flips.tried(flips.files(made.base("released")), changed, seed)
            lines = [["flip", *(counts[kind] for kind in ("told", "no effect", "silent"))]]
            print(table(("damage", "detected", "without effect", "silent"), lines))
            print("\n".join(silent))
            bad = bad or bool(silent) or _damages(made, place / "damaged", seed)
    return int(bad)


def _damages(made: Worlds, folder: Path, seed: int) -> bool:
    """Damage of every kind at every place; whether anything of it was not told."""
    count = int(os.environ.get("KB_CHAOS_DAMAGES") or 5)
    lines: list[list[object]] = []
    bad = False
    for place, kind, counts, said in damaged.all_places(made, folder, count, seed):
        noted(place=place, kind=kind, counts=counts, said=said)
        print("\n".join(said), flush=True)
        lines.append([place, kind, count, *(counts[one] for one in damaged.OUTCOMES)])
        bad = bad or bool(said)
    print(table(("place", "damage", "tried", *damaged.OUTCOMES), lines))
    return bad


if __name__ == "__main__":
    sys.exit(main())
