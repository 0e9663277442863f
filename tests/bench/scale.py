"""Raw to release at a share of the paper's size: every stage's wall time, CPU time and peak memory,
what reading alone costs (the floor), and what that makes at 100 %.

    python -m tests.bench.scale 0.05
        --code DIR       another checkout's code, for before and after: on the same answers, each in
                         the raw format of its checkout
        --keep FILE      write the figures; --against FILE: compare with figures written before
        --work DIR       where raw data and roots are made (default /tmp/lorecrawl-scale)
        --only STAGE     a stage alone, of a root that an earlier run has left; may be repeated

What every command costs before it sees data is measured at a tiny share and taken off before the
rest is multiplied. Models are apart: toxicity is off.
"""

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

from tests.bench import measured, scale_raw

HERE = Path(__file__).resolve().parents[2]
BASE = 0.0005  # a share so small that only what every command costs is seen
TO_RELEASE = (  # what lies between raw data and release/
    "youtube filter",
    "youtube export",
    "reddit filter",
    "reddit export",
    "wiki filter",
    "wiki export",
    "pairs",
    "release",
)


class Stage(NamedTuple):
    """One command. `waits`: it is ended when it sends its first request."""

    name: str
    words: tuple[str, ...]
    waits: bool = False


STAGES = (
    Stage("reddit import", ("reddit", "import", "DUMPS")),
    # The state of a crawl, made again from raw data alone; what follows finds it there.
    Stage("replay youtube", ("refresh", "youtube"), waits=True),
    Stage("replay reddit", ("refresh", "reddit"), waits=True),
    Stage("youtube filter", ("youtube", "filter")),
    Stage("youtube export", ("youtube", "export")),
    Stage("reddit filter", ("reddit", "filter")),
    Stage("reddit export", ("reddit", "export")),
    Stage("wiki filter", ("wiki", "filter")),
    Stage("wiki export", ("wiki", "export")),
    Stage("pairs", ("pairs",)),
    Stage("release", ("release",)),
    *(Stage(f"{one} text", (one, "export", "--format", "text")) for one in scale_raw.SOURCES),
    Stage("refresh youtube", ("refresh", "youtube"), waits=True),
    Stage("refresh reddit", ("refresh", "reddit"), waits=True),
    # What the services had shown as removed goes first; then a hundred ids that somebody names.
    Stage("gone youtube", ("purge", "youtube")),
    Stage("gone reddit", ("purge", "reddit")),
    Stage("purge youtube", ("purge", "youtube", "--ids", "IDS")),
    Stage("purge reddit", ("purge", "reddit", "--ids", "IDS")),
    Stage("report", ("report",)),  # last, as a purge would write one that is there again
)
_TODAY, _LATER = "2026-11-22T12:00:00Z", "2027-11-22T12:00:00Z"  # then all is due to be refreshed
_SHARED = ("reddit import", "youtube filter", "reddit filter", "wiki filter", "pairs")


_MAKE = """
import sys
from pathlib import Path
from tests.bench import scale_raw

root, share = Path(sys.argv[1]), float(sys.argv[2])
scale_raw.make(root, share)
scale_raw.dumps(root / "dumps", share)
"""


class Bench:
    """One checkout's code on raw data of one share."""

    def __init__(self, work: Path, code: Path, share: float, workers: int) -> None:
        self.share, self.code, self.workers = share, code, workers
        self.raw = work / f"raw-{share:g}-{code.name}"
        self.root = work / f"root-{share:g}-{code.name}"
        self.profile = work / f"profile-{code.name}" / "profile.toml"

    def prepare(self, *, fresh: bool) -> None:
        """Raw data, once a share; a root that shares its bytes; a profile without models."""
        if not (self.raw / "made").exists():
            shutil.rmtree(self.raw, ignore_errors=True)
            env = {**os.environ, "PYTHONPATH": str(self.code)}
            command = [sys.executable, "-c", _MAKE, str(self.raw), str(self.share)]
            subprocess.run(command, env=env, cwd=self.code, check=True)
            (self.raw / "made").touch()
        if fresh or not self.root.exists():
            shutil.rmtree(self.root, ignore_errors=True)
            shutil.copytree(self.raw, self.root, copy_function=os.link)
        shipped = self.code / "data/profiles/minecraft"
        shutil.copytree(shipped, self.profile.parent, dirs_exist_ok=True)
        text = self.profile.read_text(encoding="utf-8")
        assert 'toxicity = "on"' in text
        self.profile.write_text(text.replace('toxicity = "on"', 'toxicity = "off"'))

    def run(self, stage: Stage) -> measured.Measured:
        """Run a stage on what those before it have left. Raises RuntimeError where it fails."""
        root, words = self.root, list(stage.words)
        if stage.name == "reddit import":
            root = self.root / "imported"
            shutil.rmtree(root, ignore_errors=True)
            words[2:] = [str(path) for path in sorted((self.raw / "dumps").glob("*.zst"))]
        if "IDS" in words:
            words[words.index("IDS")] = str(self._ids(stage.name.split()[1]))
        command = [sys.executable, "-c", "from kb.cli import main; main()", *words]
        command += ["--data", str(root), "--profile", str(self.profile), "--json", "--quiet"]
        if stage.name in _SHARED:
            command += ["--workers", str(self.workers)]
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.setblocking(False)
            env = self._env(server.getsockname()[1])
            env["KB_NOW"] = _LATER if stage.waits else _TODAY
            found = measured.run(
                command, env, self.code, (lambda: _asked(server)) if stage.waits else None
            )
        # A release, also one that a purge makes again, is read as a whole before it is refused, as
        # no text has a score.
        if found.code and not (found.code == 1 and "release is refused" in found.said):
            raise RuntimeError(f"{stage.name} ended with {found.code}:\n{found.said[-2000:]}")
        return found

    def _env(self, port: int) -> dict[str, str]:
        here = f"http://127.0.0.1:{port}"
        names = ("KB_YOUTUBE_ENDPOINT", "KB_YOUTUBE_WEB", "KB_REDDIT_ENDPOINT", "KB_WIKI_URL")
        own = dict.fromkeys(names, here) | dict.fromkeys(
            ("YOUTUBE_API_KEY", "REDDIT_CLIENT_ID", "REDDIT_CLIENT_SECRET"), "none"
        )
        path = {"PYTHONPATH": str(self.code)}
        kept = {name: value for name, value in os.environ.items() if not name.startswith("KB_")}
        return {**kept, **own, **path, "KB_CONTACT": "bench@lorecrawl.invalid"}

    def _ids(self, source: str) -> Path:
        """A hundred ids that are there, all over the raw data."""
        videos, posts = round(scale_raw.VIDEOS * self.share), round(scale_raw.POSTS * self.share)
        if source == "youtube":
            ids = [scale_raw.video_id(videos * number // 100) for number in range(100)]
        else:
            ids = [f"t3_p{posts // 2 * number // 100:x}" for number in range(100)]
        path = self.root / f"gone-{source}.txt"
        path.write_text("\n".join(ids) + "\n")
        return path

    def floor(self, stage: Stage) -> float:
        """CPU seconds of reading alone what the stage reads, in the raw format of the code."""
        command = [sys.executable, "-m", "tests.bench.scale_floor", stage.name, str(self.root)]
        env = {**os.environ, "PYTHONPATH": str(self.code)}
        found = measured.run(command, env, self.code)
        if found.code:
            raise RuntimeError(found.said[-2000:])
        return float(found.said.split()[-1])


def _asked(server: socket.socket) -> bool:
    try:
        server.accept()[0].close()
    except BlockingIOError:
        return False
    return True


def figures(
    work: Path,
    code: Path,
    share: float,
    workers: int,
    only: list[str],
    keep: Path | None = None,
) -> dict[str, Any]:
    """Every stage at `share` and at the base share; `keep` has what is measured so far."""
    made: dict[str, Any] = {"share": share, "base": BASE, "workers": workers, "stages": {}}
    small, large = Bench(work, code, BASE, workers), Bench(work, code, share, workers)
    for bench in (small, large):
        bench.prepare(fresh=not only)
    for stage in STAGES:
        if only and stage.name not in only:
            continue
        base, floor_of_base = small.run(stage), small.floor(stage)
        # Purge takes away what its floor reads, so the floor comes first.
        found: dict[str, float] = {}
        if stage.words[0] == "purge":
            found["floor"] = large.floor(stage)
        got = large.run(stage)
        found |= {"wall": got.wall, "cpu": got.cpu, "peak": got.peak}
        found |= {"base_wall": base.wall, "base_cpu": base.cpu, "base_floor": floor_of_base}
        if "floor" not in found:
            found["floor"] = large.floor(stage)
        made["stages"][stage.name] = found
        if keep is not None:
            keep.write_text(json.dumps(made, indent=1) + "\n")
        print(f"  {stage.name}: {got.wall:.1f} s", file=sys.stderr)
    return made


def at_full(found: dict[str, float], what: str, share: float, base: float) -> float:
    """A figure at 100 %: what every run costs, and the rest in proportion."""
    slope = max(0.0, found[what] - found[f"base_{what}"]) / (share - base)
    return found[f"base_{what}"] + slope * (1 - base)


def table(made: dict[str, Any], before: dict[str, Any] | None = None) -> str:
    """The figures for people."""
    share, base = made["share"], made["base"]
    head = f"{'stage':16} {'wall s':>8} {'CPU s':>8} {'MiB':>6} {'floor':>7} {'x floor':>7}"
    head += f" {'100 %: CPU s':>13} {'wall s':>8}"
    lines = [f"share {share:g}, {made['workers']} workers", head + ("   before" if before else "")]
    total = dict.fromkeys(("cpu", "wall"), 0.0)
    for name, found in made["stages"].items():
        full = {what: at_full(found, what, share, base) for what in ("cpu", "wall", "floor")}
        if name in TO_RELEASE:
            total = {what: total[what] + full[what] for what in total}
        line = f"{name:16} {found['wall']:8.1f} {found['cpu']:8.1f} {found['peak']:6.0f}"
        line += f" {found['floor']:7.2f} {full['cpu'] / max(full['floor'], 1e-9):7.1f}"
        line += f" {full['cpu']:13,.0f} {full['wall']:8,.0f}"
        old = before["stages"].get(name) if before else None
        if before and old:
            then = at_full(old, "cpu", before["share"], before["base"])
            line += f"   {then:,.0f} CPU s, {then / full['cpu']:.2f} x as fast now"
        lines.append(line)
    cores = os.cpu_count() or 1
    lines.append(
        f"raw to release at 100 %: {total['cpu']:,.0f} CPU s = {total['cpu'] / cores / 60:.0f}"
        f" minutes on {cores} cores that are always busy; as measured {total['wall'] / 60:.0f}"
        f" minutes; peak {max(found['peak'] for found in made['stages'].values()):,.0f} MiB"
    )
    return "\n".join(lines)


def main() -> None:
    """Run the bench as asked, and print its table."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("share", type=float)
    options.add_argument("--code", type=Path, default=HERE)
    options.add_argument("--work", type=Path, default=Path("/tmp/lorecrawl-scale"))
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument("--only", action="append", default=[])
    options.add_argument("--keep", type=Path)
    options.add_argument("--against", type=Path)
    said = options.parse_args()
    code, before = said.code.resolve(), said.against and json.loads(said.against.read_text())
    print(table(figures(said.work, code, said.share, said.workers, said.only, said.keep), before))


if __name__ == "__main__":
    main()
