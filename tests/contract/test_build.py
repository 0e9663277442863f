"""`kb build`: what is out of date is made, in order; nothing stale is released."""

import json
import random
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.sandbox.reddit.service import dumps
from kb.sandbox.world import World
from kb.store.artifact_registry import ARTIFACTS
from tests.conftest import needs
from tests.contract.conftest import Figureless as Job
from tests.faults import Sandbox
from tests.labels import answers

needs("torch")

STEPS = (
    *("youtube export", "youtube export --format text", "youtube export --format minedojo"),
    *("reddit export", "reddit export --format text", "reddit export --format minedojo"),
    *("pairs", "pairs --format video2dataset", "pairs --format minedojo"),
    *("tasks", "tasks --format minedojo", "links", "index", "report", "search hello"),
    "pairs measure --plan",
)


@pytest.fixture(scope="module")
def crawled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """Raw answers of two sources, which tests copy."""
    world = World(n_channels=6, n_videos=40, n_posts=16, width=12, depth=4)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"), toxicity=True)
        job.done("youtube", "crawl")
        job.done("reddit", "crawl")
        yield job


@pytest.fixture(scope="module")
def made(crawled: Job, tmp_path_factory: pytest.TempPathFactory) -> Job:
    """The same, and what `kb build` makes of them."""
    job = copied(crawled, tmp_path_factory.mktemp("made"))
    done = job.done("build")
    assert (done["failed"], done["made"]) == (0, 14)
    assert {one["outcome"] for one in done["steps"]} == {"made"}
    return job


@pytest.fixture
def unbuilt(crawled: Job, tmp_path: Path) -> Job:
    """A root of its own with these answers."""
    return copied(crawled, tmp_path)


@pytest.fixture
def job(made: Job, tmp_path: Path) -> Job:
    """A root of its own in which nothing is left to do."""
    return copied(made, tmp_path)


def copied(job: Job, place: Path) -> Job:
    shutil.copytree(job.root, place / "data", symlinks=True)
    copy = Job(job.sandbox, place, toxicity=True)
    copy.profile()
    return copy


def test_empty_is_a_size(job: Job) -> None:
    """Where nothing passed the filter, every later step makes nothing of it, and ends well; people
    are not asked to judge nothing.
    """
    job.profile(
        ("min_views = 100", "min_views = 500_000_000"), ("min_score = 5", "min_score = 500_000")
    )
    for source in ("youtube", "reddit"):
        assert job.done(source, "filter", code=1)["kept"] == 0
    for step in STEPS:
        done = job.kb(*step.split())
        assert done.returncode == 0, f"kb {step}: {done.stderr}"
    for kind in ("pairs", "tasks"):
        line = job.stopped("label", "export", kind, "--out", kind, code=1)
        assert f"there are no {kind} to judge" in line
    job.done("verify")  # exit 0: an empty list is whole


def edit(job: Job, name: str, *changes: tuple[str, str]) -> None:
    path = job.place / "profile" / name
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")


def files(root: Path, *folders: str) -> dict[str, tuple[int, int, bytes]]:
    """Inode, time of change and content of each file of the folders."""
    found = {}
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.is_file():
                it = path.stat()
                found[str(path.relative_to(root))] = it.st_ino, it.st_mtime_ns, path.read_bytes()
    return found


MADE = ("state/manifests", "clean", "pairs", "tasks", "links", "index", "report", "release")


def planned(job: Job, *names: str) -> dict[str, list[str]]:
    return {one["artifact"]: one["reasons"] for one in job.done("build", *names, "--plan")["steps"]}


def test_a_second_run_writes_nothing_and_a_change_is_named(job: Job) -> None:
    before = files(job.root, *MADE)
    again = job.done("build")
    assert (again["made"], again["current"], again["steps"]) == (0, 14, [])
    assert files(job.root, *MADE) == before
    assert "nothing is left to do" in job.kb("status").stdout

    edit(job, "profile.toml", ("min_views = 100", "min_views = 100_000"))
    plan = planned(job)
    assert plan["clean/youtube"] == ["youtube.min_views 100 → 100000"]
    assert plan["release/pairs"] == ["pairs"]
    assert not {"clean/reddit", "release/reddit", "index/reddit"} & plan.keys()
    assert [one["reasons"] for one in job.done("status")["stale"]] == list(plan.values())
    refused = job.kb("release")
    assert refused.returncode == 1
    assert "youtube.min_views 100 → 100000" in refused.stderr
    assert "kb build" in refused.stderr
    assert files(job.root, *MADE) == before
    job.done("youtube", "filter")
    assert job.kb("release").returncode == 1  # pairs of videos that were dropped
    job.done("build")
    assert planned(job) == {}


def test_keywords_are_named_by_lines_and_what_turns_out_the_same_is_left(job: Job) -> None:
    edit(job, "keywords.tsv", ("keyword\t", "# a remark\nkeyword\t"))
    assert list(planned(job)) == []  # a remark says nothing
    text = (job.place / "profile" / "keywords.tsv").read_text(encoding="utf-8")
    added = "".join(f"Zzqx{word}\tthing\t\t\n" for word in ("one", "two", "three"))
    (job.place / "profile" / "keywords.tsv").write_text(text + added, encoding="utf-8")
    plan = planned(job)
    assert plan["pairs"] == ["keywords.tsv, 3 lines"]
    assert "clean/youtube" not in plan
    before = files(job.root, "release/pairs")
    steps = {one["artifact"]: one["outcome"] for one in job.done("build", "pairs")["steps"]}
    assert steps == {"pairs": "made", "release/pairs": "unchanged"}  # nobody says these words
    assert files(job.root, "release/pairs") == before


def test_formats_are_made_when_they_are_named(unbuilt: Job) -> None:
    job = unbuilt
    job.done("build", "text")
    assert (job.root / "export/text/youtube.jsonl").is_file()
    assert not (job.root / "pairs").exists()
    before = files(job.root, "export")
    assert job.done("build", "text")["made"] == 0
    assert files(job.root, "export") == before
    assert not any(name.startswith("export/") for name in planned(job))
    refused = job.kb("build", "nothing")
    assert refused.returncode == 2
    assert "'nothing'" in refused.stderr


def test_a_folder_that_is_released_for_the_first_time_is_described_by_the_same_build(
    unbuilt: Job,
) -> None:
    for step in ("youtube filter", "youtube export", "release"):
        unbuilt.done(*step.split())
    assert unbuilt.done("build", "release")["failed"] == 0
    assert planned(unbuilt, "release") == {}


def test_after_a_failure_everything_else_is_still_made(job: Job) -> None:
    """Of YouTube nothing is kept, which is a size; damaged raw data of Reddit are a failure."""
    edit(job, "profile.toml", ("min_views = 100", "min_views = 500_000_000"))
    (segment, *_) = sorted((job.root / "raw/reddit").glob("*/*.zst"))
    data = segment.read_bytes()
    segment.write_bytes(data[: len(data) // 2])
    done = job.done("build", code=1)
    outcomes = {one["artifact"]: one["outcome"].partition(":")[0] for one in done["steps"]}
    assert outcomes["clean/youtube"] == outcomes["clean/reddit"] == "failed"
    assert outcomes["pairs"] == outcomes["release/pairs"] == "made"
    assert outcomes["release/reddit"] == outcomes["links"] == "left out"
    segment.write_bytes(data)
    assert job.done("build")["failed"] == 0


def test_a_root_stands_without_its_profile(unbuilt: Job) -> None:
    """Moved, and with the profile gone, it is built, searched and judged by its own copy."""
    job = unbuilt
    job.done("build", "pairs")
    shutil.move(job.root, job.place / "moved")
    shutil.rmtree(job.place / "profile")
    del job.env["KB_PROFILE"]
    job.root = job.place / "moved"
    job.env["KB_DATA"] = str(job.root)
    done = job.kb("build", "pairs", "--plan", "--json")
    assert "its copy in the data root is used" in done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["steps"] == []
    for step in ("search creeper", "pairs", "label export pairs --out judged", "verify"):
        assert job.kb(*step.split()).returncode == 0, step
    job.profile(("min_views = 100", "min_views = 101"))
    assert planned(job, "youtube")["clean/youtube"] == ["youtube.min_views 100 → 101"]


def test_what_reads_stale_tables_warns_or_refuses(job: Job) -> None:
    edit(job, "profile.toml", ("min_gap_s = 0", "min_gap_s = 5"))
    for step in ("query SELECT+1", "search creeper", "report"):
        done = job.kb(*(word.replace("+", " ") for word in step.split()))
        assert done.returncode == 0
        assert "out of date: pairs: pairs.min_gap_s 0.0 → 5.0" in done.stderr, step
    refused = job.kb("label", "export", "pairs", "--out", "judged")
    assert refused.returncode == 1
    assert "kb build pairs" in refused.stderr
    assert job.kb("label", "export", "tasks", "--out", "judged").returncode == 0


def test_stored_scores_need_no_model(job: Job) -> None:
    nowhere = {"KB_TOXICITY_MODEL": "/nowhere/model.ckpt"}
    edit(job, "profile.toml", ("min_views = 100", "min_views = 200"))
    job.done("build", "youtube", **nowhere)
    shutil.rmtree(job.root / "annotations")
    assert job.kb("youtube", "filter", **nowhere).returncode == 2


EDITS = {  # what each may make out of date, besides all that is made of it
    "min_views": {"clean/youtube"},
    "min_score": {"clean/reddit"},
    "max_gap_s": {"tasks"},
    "min_gap_s": {"pairs"},
    "keywords": {"pairs", "tasks", "links"},
    "purge": {"clean/youtube"},
    "recount": {"clean/youtube"},
    "import": {"clean/reddit"},
    "judge": {"pairs", "tasks"},  # pairs/measures.json has the judgements of both
}
COMMANDS = (
    "youtube filter",
    "reddit filter",
    "youtube export",
    "pairs",
    "tasks",
    "links",
    "build release",
)
WITHOUT_REPORT = ("release", "tasks", "links")  # whose figures take longest
COMPARED = ("clean", "pairs", "tasks", "links", "release")


def changed_by(job: Job, chance: random.Random, what: str) -> None:
    """Another value of a setting, another keyword, other raw answers, or a judgement."""
    profile = job.place / "profile"
    if what == "recount":  # a video has fewer views than before
        videos = job.sandbox.world.youtube.videos
        videos[chance.choice(sorted(videos))].view_count = "7"
        job.done("refresh", "youtube", "--older-than", "0")
    elif what == "import":
        months = dumps(job.sandbox.world.reddit, job.place / "dumps")
        job.done("reddit", "import", str(chance.choice(months)))
    elif what == "judge":
        project, number = job.place / "judged", len(list(job.place.glob("answers-*.json")))
        shutil.rmtree(project, ignore_errors=True)
        if job.kb("label", "export", "tasks", "--out", str(project)).returncode == 0:
            item = chance.choice(answers.items(project))
            said = answers.judgement(chance.randrange(3), is_task=chance.choice(["yes", "no"]))
            file = answers.exported(job.place / f"answers-{number}.json", [(item, [said])])
            job.done("label", "import", str(file))
    elif what == "purge":
        rows = pq.read_table(job.root / "clean/youtube/videos", columns=["video_id"])
        (job.place / "gone.txt").write_text(chance.choice(rows["video_id"].to_pylist()))
        job.done("purge", "youtube", "--ids", str(job.place / "gone.txt"))
    elif what == "keywords":
        word = chance.choice(["there", "because", "really", "qzx", "people"])
        with (profile / "keywords.tsv").open("a", encoding="utf-8") as file:
            file.write(f"{word}{chance.randrange(9)}\tword\talways\t{word}\n")
    else:
        path = profile / "profile.toml"
        text = path.read_text(encoding="utf-8")
        section = "[tasks]\n" if what == "max_gap_s" else ""
        value = f"{what} = {chance.randrange(5, 60)}"
        if re.search(rf"(?m)^{what} = .*$", text):
            text = re.sub(rf"(?m)^{what} = [^#\n]*", f"{value} ", text)
        else:
            text = text.replace(section, section + value + "\n", 1)
        path.write_text(text, encoding="utf-8")


def content(root: Path) -> dict[str, dict[str, bytes]]:
    """By artifact, the bytes of its files but for the manifests."""
    found: dict[str, dict[str, bytes]] = {}
    for name, (_, _, data) in files(root, *COMPARED).items():
        parts = name.split("/")
        artifact = "/".join(parts[:2]) if parts[0] in ("clean", "release") else parts[0]
        if parts[-1] != "_manifest.json":
            found.setdefault(artifact, {})[name] = data
    return found


@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3, 4))])
def test_after_any_sequence_a_build_gives_what_a_fresh_root_has(job: Job, seed: int) -> None:
    """And before it every artifact whose bytes would differ is named."""
    chance = random.Random(seed)
    for _ in range(2):
        done = set()
        for _ in range(3):
            if chance.random() < 0.6:
                done.add(what := chance.choice([*EDITS]))
                changed_by(job, chance, what)
            else:
                job.kb(*chance.choice(COMMANDS).split())
        before, named = content(job.root), planned(job, *WITHOUT_REPORT)
        expected = {"release", *(artifact for one in done for artifact in EDITS[one])}
        for name in named:  # inputs first
            if expected & {name, *(ARTIFACTS[name].inputs if name in ARTIFACTS else ())}:
                expected.add(name)
        assert named.keys() <= expected, (seed, done)
        job.done("build", *WITHOUT_REPORT)
        after = content(job.root)
        differ = {one for one in before.keys() | after.keys() if before.get(one) != after.get(one)}
        described = (
            {one for one in differ if one.startswith("release/")} if "release" in named else set()
        )
        assert differ <= named.keys() | described, (seed, done)
        assert planned(job, *WITHOUT_REPORT) == {}
    fresh = job.place / "fresh"
    for folder in ("raw", "state", "annotations"):
        shutil.copytree(job.root / folder, fresh / folder)
    shutil.rmtree(fresh / "state/manifests")
    job.done("build", *WITHOUT_REPORT, KB_DATA=str(fresh))
    if judged := sorted(map(str, job.place.glob("answers-*.json"))):
        job.done("label", "import", *judged, KB_DATA=str(fresh))
        job.done("build", *WITHOUT_REPORT, KB_DATA=str(fresh))
    assert content(fresh) == content(job.root)
