"""A person who asks to be left out leaves every file, and nothing of theirs comes in again."""

import json
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.pipeline import Recipe
from kb.core.errors import SettingError
from kb.reddit import purge
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.parse.anonymize import Scrubber, keyed, load_key
from kb.reddit.purge import name_of
from kb.reddit.restore.reconstruct import rebuild
from kb.sandbox.reddit.subreddit import CASES
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from tests.crash import harm
from tests.recipes import release
from tests.reddit.dumped import imported, post, run_in, write
from tests.reddit.work import Work, rows, texts

NAME = "Loud_Badger-77"
MARK = "Quirkenwold"  # in what they wrote
PROFILE = f"https://www.reddit.com/user/{NAME}/comments/zz9/about/"


def write_as(work: Work, *names: str) -> None:
    """Make posts and comments of the world this person's."""
    for number, name in enumerate(names):
        thing = work.world.posts.get(name[3:]) or work.world.comments[name[3:]]
        text = f"{MARK} {number}"
        thing |= {"author": NAME} | ({"title": text} if "title" in thing else {"body": text})


def talk(work: Work, *but: str) -> list[str]:
    """Full names of comments that are there, but for those below some posts."""
    gone = ("[deleted]", "[removed]")
    return [
        f"t1_{key}"
        for key, comment in work.world.comments.items()
        if comment["body"] not in gone and comment["link_id"] not in but
    ]


@pytest.fixture
def theirs(few: Work) -> tuple[Work, list[str]]:
    """A crawled root with two posts and three comments of a person, one with replies of others."""
    posts = list(few.world.posts)
    text, image, link = (posts[CASES.index(case)] for case in ("text", "image", "link"))
    answered = next(name for name in talk(few) if name in few.world.replies)
    others = [name for name in talk(few) if name not in few.world.replies]
    own = [f"t3_{text}", f"t3_{image}", answered, others[0], others[-1]]
    write_as(few, *own)
    # What others have of them: a link to their profile, a moderator's note, and words.
    few.world.posts[link] |= {"url_overridden_by_dest": PROFILE, "approved_by": NAME.upper()}
    few.crawl()
    return few, own


def dump_of(work: Work, name: str) -> Path:
    """The world's posts and comments as an archive has them."""
    comments = ({**one, "replies": ""} for one in work.world.comments.values())
    return write(work.place / f"{name}.zst", [*work.world.posts.values(), *comments])


def cleaned(work: Work) -> dict[str, list[dict[str, Any]]]:
    """The clean tables; how deep a reply to a purged comment is, only a purge still knows."""
    tables = {name: work.table("clean", "reddit", name) for name in ("posts", "comments")}
    return {
        name: [{key: row[key] for key in row if key != "depth"} for row in found]
        for name, found in tables.items()
    }


def hash_of(work: Work) -> str:
    return keyed(load_key(work.root), NAME.lower())


def listed(work: Work, *lines: str) -> Path:
    path = work.place / "request.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def traces(work: Work, *needles: str) -> list[str]:
    """Files of the data root with one of these, but for tombstones."""
    return [
        f"{needle} in {path}"
        for path, found in work.text().items()
        for needle in needles
        if needle.lower() in found.lower() and Path(path).stem != "tombstones"
    ]


def test_a_person_leaves_every_file(theirs: tuple[Work, list[str]]) -> None:
    work, own = theirs
    job, person = work.job(), hash_of(work)
    exports = ("reddit export", "reddit export --format text")
    for words in ("reddit filter", *exports, "links", "release"):
        job.done(*words.split())
    job.done("reddit", "reconstruct", "--out", str(Layout(work.root).reconstructed))
    job.done("index")
    assert len({note.split(" in ")[1] for note in traces(work, MARK, person)}) > 6
    assert not traces(work, NAME)

    file = listed(work, "# by mail, 3 March", "", f"u/{NAME.lower()}", "[deleted]", NAME.upper())
    before = job.digests()
    plan = job.done("purge", "reddit", "--authors", str(file), "--plan")
    assert job.digests() == before
    said = job.kb("purge", "reddit", "--authors", str(file), "--json")
    summary = json.loads(said.stdout.splitlines()[-1])
    assert said.returncode == 0
    assert "--authors: unread, as it names nobody: line 4" in said.stderr
    for printed in (said.stdout, said.stderr):
        assert not [word for word in (NAME.lower(), person, "[deleted]") if word in printed.lower()]
    for counts in (plan, summary):
        gone = {name: counts[name] for name in ("known", "unknown", "unread")}
        assert gone == {"known": 0, "unknown": 0, "unread": 1}
    assert summary["purged"] == plan["purged"] >= len(own)
    assert summary["rows"] >= len(own)
    assert not traces(work, NAME, MARK, person, *(name[3:] for name in own))
    assert not list(Layout(work.root).state_folder().glob("*.purge.json"))

    # Others' replies and records stay, the answers of a second filter are those that are there.
    clean = cleaned(work)
    replies = {name[3:] for name in work.world.replies[own[2]]} & {n[3:] for n in talk(work)}
    assert replies <= {row["comment_id"] for row in clean["comments"]}
    assert [row for row in clean["posts"] if row["source_url"] == PROFILE.replace(NAME, "[purged]")]
    job.done("reddit", "filter")
    assert cleaned(work) == clean

    # Items have tombstones that leave with a release, the person has one that does not.
    released = (work.root / "release/reddit/tombstones.ndjson").read_text()
    keys = {json.loads(line)["key"] for line in released.splitlines()}
    assert set(own) <= keys == tombstones.keys(work.root, "reddit")
    assert tombstones.people(work.root, "reddit") == {person}
    view = job.kb("query", "SELECT key FROM reddit_tombstones", "--format", "ndjson").stdout
    assert {json.loads(line)["key"] for line in view.splitlines()} == keys
    assert person not in job.kb("query", "--tables").stdout + view
    again = job.done("purge", "reddit", "--authors", str(file))
    assert (again["purged"], again["known"], again["unknown"]) == (0, 1, 0)


@pytest.mark.parametrize("way", ["crawl", "import", "refresh", "raw of another machine"])
def test_what_they_write_later_stays_away(
    theirs: tuple[Work, list[str]], way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, _ = theirs
    work.purge(people=listed(work, NAME))
    before = tombstones.keys(work.root, "reddit")
    post = next(key for key in reversed(work.world.posts) if f"t3_{key}" not in before)
    later = [name for name in talk(work, f"t3_{post}") if name not in before]
    later = [f"t3_{post}", *[name for name in later if name not in work.world.replies][:2]]
    write_as(work, *later)
    if way in ("crawl", "import"):  # nothing is known of the subreddit any more
        shutil.rmtree(work.root / "raw" / "reddit" / "listings")
        shutil.rmtree(work.root / "raw" / "reddit" / "comments")
        (work.root / "state" / "reddit.sqlite").unlink()
    if way == "import":
        work.take_in([dump_of(work, "later")])
    elif way == "crawl":
        summary = work.crawl()
        assert summary["left"] == summary["failed"] == 0
    elif way == "refresh":
        monkeypatch.setenv("KB_NOW", "2027-03-01T12:00:00Z")
        work.refresh()
    else:
        other = Work(work.sandbox, tmp_path / "other", **work.section)
        Layout(other.root).state_folder().mkdir(parents=True, exist_ok=True)
        shutil.copyfile(Layout(work.root).key("reddit"), Layout(other.root).key("reddit"))
        other.crawl()
        for path in (other.root / "raw").rglob("*.zst"):
            place = work.root / path.relative_to(other.root)
            shutil.copyfile(path, place.with_name(f"other-{place.name}"))
    work.filter()
    clean = {
        *(f"t3_{row['post_id']}" for row in work.table("clean", "reddit", "posts")),
        *(f"t1_{row['comment_id']}" for row in work.table("clean", "reddit", "comments")),
    }
    assert clean
    if way != "refresh":  # they were others' when they were read
        assert clean & {*later, *before} == set()
    assert not [row for row in work.table("clean", "reddit", "rejected") if row["key"] in later]
    assert tombstones.keys(work.root, "reddit") == before, "none for what came later"
    if way == "raw of another machine":
        assert traces(work, MARK)
        work.purge()
    assert not traces(work, NAME, MARK, hash_of(work))


def test_whoever_collected_the_same_follows_the_released_tombstones(
    theirs: tuple[Work, list[str]], tmp_path: Path
) -> None:
    work, own = theirs
    other = Work(work.sandbox, tmp_path / "other", **work.section)
    other.crawl()
    other.filter()
    work.filter()
    work.export()
    work.purge(people=listed(work, NAME))
    release(work.run(), ["reddit"])
    released = work.root / "release" / "reddit" / "tombstones.ndjson"
    assert other.purge(released)["unread"] == 0
    assert not traces(other, MARK, *(name[3:] for name in own))


@pytest.mark.parametrize("source", ["service", "dumps"])
def test_no_reconstruction_brings_them_back(theirs: tuple[Work, list[str]], source: str) -> None:
    work, own = theirs
    out = work.place / "out"
    elsewhere = [name for name in talk(work, *own) if name not in {*own, *work.world.replies}]
    later, others = elsewhere[:2], elsewhere[2]
    ids = work.place / "ids.txt"
    ids.write_text("\n".join([*own, *later, others]) + "\n")
    files = [dump_of(work, "first")] if source == "dumps" else []
    rebuild(work.run(), ids, out, dumps=files)
    assert MARK in " ".join(texts(out).values())
    work.purge(people=listed(work, NAME))
    write_as(work, *later)
    if source == "dumps":
        files = [dump_of(work, "later")]
    rebuild(work.run(again=True), ids, out, dumps=files)
    left = " ".join(texts(out).values())
    assert MARK not in left
    assert NAME not in left
    assert {row["comment_id"] for row in rows(out / "comments")} == {others[3:]}
    missing = {row["key"]: row["reason"] for row in rows(out, "missing.parquet")}
    assert missing == dict.fromkeys([*own, *later], "purged")


def test_what_only_a_restored_table_has_is_found(theirs: tuple[Work, list[str]]) -> None:
    """Of a downloaded release: no raw answers, and hashes by this root's own key."""
    work, own = theirs
    ids = work.place / "ids.txt"
    ids.write_text("\n".join([*own, *talk(work)]) + "\n")
    place = Layout(work.root).restored("reddit")
    work.rebuild(ids, place)
    shutil.rmtree(work.root / "raw")
    (work.root / "state" / "reddit.sqlite").unlink()
    before = len(rows(place / "comments"))
    summary = work.purge(people=listed(work, NAME))
    assert (summary["purged"], summary["unknown"]) == (len(own), 0)
    assert not traces(work, MARK, hash_of(work), *(name[3:] for name in own))
    assert 0 < len(rows(place / "comments")) < before


def test_what_others_records_show_of_them_goes(tmp_path: Path) -> None:
    """A crosspost's parent and a comment's post are theirs though no answer has them."""
    parent = {
        "id": "parent1",
        "author": NAME,
        "title": f"{MARK} 1",
        "url": f"https://v.redd.it/{MARK}",
    }
    fields = {"subreddit": "Minecraft", "created_utc": 1_600_000_000, "score": 1}
    records = [
        post(
            "cross",
            crosspost_parent="t3_parent1",
            crosspost_parent_list=[parent],
            url=parent["url"],
        ),
        post("plain", selftext=f"thanks to u/{NAME}"),
        {"id": "below", "link_id": "t3_gone1", "parent_id": "t3_gone1", "author": "other_otter"}
        | {"link_author": NAME.upper(), "link_title": f"{MARK} 2", "body": "yes", **fields},
        {"author": NAME, "body": f"{MARK} 3, without an id", "link_id": "t3_plain", **fields},
    ]
    file = write(tmp_path / "RS.zst", records)
    for later in (False, True):
        root = tmp_path / f"root-{later}"
        (tmp_path / "names").write_text(NAME)
        run = run_in(root)
        purge = Recipe("purge").defined("purge")
        if later:
            root.mkdir()
            assert purge(run, "reddit", None, tmp_path / "names")["unknown"] == 1
        import_dumps(run, [file])
        if not later:
            summary = purge(run, "reddit", None, tmp_path / "names")
            assert (summary["purged"], summary["unknown"]) == (2, 0)
        found = {data["id"]: data for _, data in imported(root)}
        assert found.keys() == {"cross", "plain"}
        assert found["cross"]["crosspost_parent_list"] == []
        assert NAME in found["plain"]["selftext"], "what others wrote stays"
        assert MARK not in str(found)
        assert keyed(load_key(root), NAME.lower()) not in str(found)


@pytest.mark.parametrize(
    "entry",
    [
        NAME,
        NAME.upper(),
        f"u/{NAME}",
        f"/u/{NAME.lower()}",
        f"U/{NAME}/",
        f"/user/{NAME}/submitted",
        f"reddit.com/u/{NAME}",
        f"https://www.reddit.com/user/{NAME}",
        f"http://old.reddit.com/user/{NAME}/comments/?sort=new",
        f"https://np.reddit.com/u/{NAME}?utm_source=share",
        f"https://NEW.Reddit.com/User/{NAME}#about",
        f"https://www.reddit.com/user/{NAME}/comments/abc123/my_title/",
        f"https://www.reddit.com/r/u_{NAME}/comments/abc123/my_title/",
        f"r/u_{NAME}",
    ],
)
def test_every_form_of_a_name_is_the_same_person(entry: str) -> None:
    found = name_of(entry)
    assert found is not None
    assert found.lower() == NAME.lower()


@pytest.mark.parametrize(
    "entry",
    [
        "[deleted]",
        "[removed]",
        "u/",
        "https://www.reddit.com/r/Minecraft/comments/abc123/a_title/",
        "https://www.reddit.com/",
        f"https://example.com/user/{NAME}",
        f"https://reddit.com.example.com/user/{NAME}",
        "two words",
        "name@example.com",
        "é",
    ],
)
def test_what_names_nobody_is_not_read(entry: str) -> None:
    assert name_of(entry) is None


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_list_of_names(tmp_path: Path, encoding: str, end: str) -> None:
    file = tmp_path / "names"
    lines = [
        "# asked by mail",
        "",
        f"  u/{NAME}  # 3 March",
        "two words",
        '"Other_One",',
        "[deleted]",
    ]
    file.write_bytes(end.join(lines).encode(encoding))
    assert purge.PEOPLE.read_people(file) == ((NAME, "Other_One"), (4, 6))


@pytest.mark.parametrize("text", ["", "# nobody\n", "[deleted]\nsecret words\n", None])
def test_a_list_without_a_name_is_refused_and_not_repeated(
    tmp_path: Path, text: str | None
) -> None:
    file = tmp_path / "secret-name.txt"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SettingError) as error:
        purge.PEOPLE.read_people(file)
    assert error.value.exit_code == 2
    assert "secret" not in f"{error.value} {error.value.hint}"


def test_names_in_other_letter_cases_have_one_hash() -> None:
    scrubber = Scrubber(b"k" * 64)
    cases = {scrubber.hash(name) for name in (NAME, NAME.upper(), NAME.lower(), NAME.title())}
    assert len(cases) == 1
    addresses = [{"url": f"/user/{name}/"} for name in (NAME, NAME.upper())]
    assert scrubber.scrub(addresses[0]) == scrubber.scrub(addresses[1])


def test_a_root_that_told_letter_cases_apart(
    theirs: tuple[Work, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hashes of names as they are written, of which the one in the request is found too."""
    work, _ = theirs
    lower, written = hash_of(work), keyed(load_key(work.root), NAME)
    for path in (work.root / "raw" / "reddit").rglob("*.zst"):
        change(path, lower, written)
    (work.root / "state" / "reddit.sqlite").unlink()
    work.filter()
    assert traces(work, written)
    assert work.purge(people=listed(work, f"u/{NAME}"))["unknown"] == 0
    assert not traces(work, MARK, written)
    assert tombstones.people(work.root, "reddit") == {lower, written}


def change(segment: Path, old: str, new: str) -> None:
    frames = [line.replace(old.encode(), new.encode()) for _, line in rawlog.Frames(segment)]
    segment.write_bytes(b"".join(rawlog.compressor().compress(line) for line in frames))


def test_a_purge_that_was_killed_goes_on(theirs: tuple[Work, list[str]]) -> None:
    """Killed at ever later moments; then without the list, whose names are written nowhere."""
    work, own = theirs
    job = work.job()
    job.done("reddit", "filter")
    job.done("reddit", "export")
    person = hash_of(work)
    file = listed(work, NAME.upper())
    words = ["purge", "reddit", "--authors", str(file)]
    shutil.copytree(work.root, work.place / "whole")
    length = harm.run([*words, "--data", "whole"], job.env, work.place).operations
    killed = 0
    for fifth in range(1, 5):
        ended = harm.run(
            words, job.env, work.place, harm=harm.KILL, before=max(1, length * fifth // 5)
        )
        killed += ended.code == -signal.SIGKILL
        assert not traces(work, NAME)
        assert NAME.lower() not in (ended.out + ended.err).lower()
        if ended.code == 0:
            break
        if Layout(work.root).purge("reddit").exists():
            words = ["purge", "reddit"]
    assert killed > 1
    job.done("purge", "reddit")
    assert not traces(work, NAME, MARK, person, *(name[3:] for name in own))
    assert tombstones.people(work.root, "reddit") == {person}
