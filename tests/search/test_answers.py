"""`kb index` and `kb search` on a clean world with one right place for each question."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import kb
from kb.artifacts import index as index_of
from kb.core.config.profile import load_profile
from kb.core.errors import DamagedData, UsageError
from kb.core.sources import SOURCES
from kb.filters.filter_run import run_clean
from kb.registry import SOURCES as CLASSES
from kb.search.answers import MOST as SNIPPET_WORDS
from kb.search.answers import search, snippet
from kb.search.build import index
from kb.search.passage import MOST_WORDS, Passage
from kb.search.ranking import Only
from kb.search.tantivy_index import analyzer
from kb.store import lock
from kb.store.artifact_registry import ARTIFACTS, MANIFEST
from kb.store.layout import Layout
from kb.verify.root import verify
from kb.youtube.passages import MOST
from tests.filters import full_root
from tests.filters.made import run_at
from tests.inprocess import Here
from tests.search.made import ACTIONS, SECRET, combinations, second, told, video_id, write

EVERY = Only(each=None, limit=1000)


def right(source: str, number: int, action: str, animal: str) -> tuple[str, str]:
    """(key, address) of the one place that tells it."""
    if source == "youtube":
        key = video_id(number)
        return key, f"https://www.youtube.com/watch?v={key}&t={int(second(number))}s"
    if source == "wiki":
        at = number // len(ACTIONS)
        page = f"https://wiki.example/w/{animal.capitalize()}?oldid={1000 + at}"
        return str(10 + at), f"{page}#Ways_to_{action}"
    post = f"https://www.reddit.com/r/Minecraft/comments/p{number:03d}/"
    if number % 2:
        return f"t1_c{number:03d}", f"{post}_/c{number:03d}/"
    return f"t3_p{number:03d}", post


@pytest.mark.parametrize("source", SOURCES)
def test_the_one_right_place_is_among_the_first_five(made: Path, source: str) -> None:
    found = 0
    for number, action, animal in combinations():
        answers = search(made, f"How to {action} a {animal}?", sources=[source], only=Only(limit=5))
        assert len(answers) == 5
        found += right(source, number, action, animal) in [(one.key, one.url) for one in answers]
    assert found >= 0.95 * len(list(combinations()))


@pytest.mark.parametrize("source", SOURCES)
def test_a_phrase_is_in_one_place_and_its_words_are_marked(made: Path, source: str) -> None:
    for number, action, animal in combinations():
        (one,) = search(made, f'"{action} the {animal}"', sources=[source])
        assert (one.key, one.url) == right(source, number, action, animal)
        marked = one.snippet.replace("** **", " ")
        assert re.search(rf"\*\*{action} the {animal}\*\*", marked), one.snippet
        assert told(number, action, animal) in one.text
        assert (
            one.licence
            == {
                "youtube": "creativeCommon" if number % 2 else "youtube",
                "wiki": "CC-BY-SA-3.0",
                "reddit": None,
            }[source]
        )


def test_every_address_is_one(made: Path) -> None:
    answers = search(made, "camel wolf the to series animals leather sleeping", only=EVERY)
    assert {one.kind for one in answers} == {
        "video", "transcript", "section", "table", "post", "comment"
    }  # fmt: skip
    hosts = {"youtube": "www.youtube.com", "wiki": "wiki.example", "reddit": "www.reddit.com"}
    for one in answers:
        parts = urlsplit(one.url)
        assert (parts.scheme, parts.netloc) == ("https", hosts[one.source])
        assert not re.search(r"\s", one.url)
        if one.kind == "transcript":
            assert one.start_s is not None
            assert parts.query == f"v={one.key}&t={int(one.start_s)}s"


def held(length: int) -> int:
    """A length as the index keeps it, in a byte."""
    at, step = 40, 2
    while length >= at + 8 * step:
        at, step = at + 8 * step, 2 * step
    return length if length <= 40 else at + (length - at) // step * step


def brute(passages: list[tuple[str, list[str]]], words: list[str]) -> list[float]:
    """BM25 by its definition: (source, its words) → scores."""
    total = len(passages)
    scores = []
    for source, held_words in passages:
        lengths = [len(other) for name, other in passages if name == source]
        mean, length = sum(lengths) / len(lengths), held(len(held_words))
        score = 0.0
        for word in words:
            having = sum(word in other for _, other in passages)
            rarity = math.log(1 + (total - having + 0.5) / (having + 0.5))
            often = held_words.count(word)
            score += rarity * often * 2.2 / (often + 1.2 * (0.25 + 0.75 * length / mean))
        scores.append(score)
    return scores


def every(root: Path) -> list[tuple[str, Passage]]:
    """All passages of the small world, by source."""
    profile = load_profile("minecraft")
    return [(name, one) for name, each in CLASSES.items() for one in each.passages(profile, root)]


@pytest.mark.parametrize("words", ["camel", "bones ride", "leather wheat yesterday"])
def test_scores_are_those_of_a_reckoning_by_hand(made: Path, words: str) -> None:
    passages, places = [], []
    for source, one in every(made):
        whole = f"{one.title} {one.title} {one.path} {one.text} {one.alt}".lower()
        stemmed = [word.replace("bones", "bone") for word in re.findall(r"\w+", whole)]
        passages.append((source, stemmed))
        places.append((one.kind, one.key, one.text.replace("\n", " " if one.times else "\n")))
    asked = words.replace("bones", "bone").split()
    having = sum(asked[0] in held for _, held in passages)
    titled = 3 * 1.02 * 1.1 * 2.2 * math.log(1 + (len(passages) - having + 0.5) / (having + 0.5))
    wanted = {
        place: pytest.approx(score + titled * (held[: len(asked)] == asked), abs=1e-3)
        for place, score, (_, held) in zip(places, brute(passages, asked), passages, strict=True)
        if score
    }
    found = search(made, words, only=EVERY, size=10_000)
    assert {(one.kind, one.key, one.text): one.score
            for one in found if one.text} == {
        place: score for place, score in wanted.items() if place[2]
    }  # fmt: skip
    scores = [one.score for one in found]
    assert scores == sorted(scores, reverse=True)
    assert len(found) > 10


def test_filters_and_how_many(made: Path) -> None:
    def keys(words: str, **only: Any) -> set[str]:
        return {one.key for one in search(made, words, only=Only(**{"limit": 1000, **only}))}

    assert keys("leather", kinds=("table",)) == {str(key) for key in range(10, 16)}
    assert keys("sleeping camel", kinds=("section",)) >= {"14"}
    assert keys("camel", since="2023-01-30", kinds=("post",)) <= {"t3_p029"}
    early = search(made, "camel", only=Only(until="2023-01-10", limit=1000))
    assert early
    assert all(one.date is not None and one.date <= "2023-01-10" for one in early)
    every = search(made, "camel", sources=["wiki"], only=EVERY)
    best = search(made, "camel", sources=["wiki"], only=Only(limit=1000))
    assert len(best) == len({one.key for one in every}) < len(every)
    assert len(search(made, "camel", sources=["wiki"], only=Only(each=2, limit=1000))) > len(best)
    middle = every[len(every) // 2].score
    assert [one.score for one in every if one.score >= middle] == [
        one.score
        for one in search(
            made, "camel", sources=["wiki"], only=Only(each=None, limit=1000, least=middle)
        )
    ]
    texts = {one.text for one in search(made, "+camel ride", only=EVERY)}
    both, barred = (
        {one.text for one in search(made, words, only=EVERY)}
        for words in ("+camel +ride", "+camel -ride")
    )
    assert both
    assert barred
    assert (both | barred, both & barred) == (texts, set())
    assert keys("lea*", kinds=("table",)) == keys("leather", kinds=("table",))
    assert not keys("lea", kinds=("table",))
    assert search(made, "camel", only=Only(limit=3), size=20)[0].text.endswith("…")
    assert all(len(one.text) <= 20 for one in search(made, "camel", size=20))


def posts(root: Path, *bodies: str, title: str = "t") -> None:
    """A thread of each text, indexed."""
    made = [
        {"post_id": f"p{n}", "type": "text", "title": title, "body": body}
        for n, body in enumerate(bodies)
    ]
    write(root, "reddit/posts", made)
    write(root, "reddit/comments", [])


def found(root: Path, words: str, **only: Any) -> list[str]:
    """The texts of the answers out of threads."""
    answers = search(root, words, sources=["reddit"], only=Only(**{"limit": 100, **only}))
    return [one.text for one in answers]


def test_a_beginning_finds_all_that_begin_so(tmp_path: Path) -> None:
    bodies = [f"a craft{n} of wood" for n in range(200)]
    posts(tmp_path, *bodies, "crafting craft7 craft7 craft7", "no such thing", "a kraft of wood")
    index(run_at(tmp_path))
    texts = found(tmp_path, "craft*", limit=500)
    assert set(texts) == {*bodies, "crafting craft7 craft7 craft7"}
    assert set(found(tmp_path, '"a craft1"*', limit=500)) == {
        body for body in bodies if body.startswith("a craft1")
    }
    assert len(found(tmp_path, '"a craft"*', limit=500)) == 200
    assert found(tmp_path, "craft* -craft* wood") == ["a kraft of wood"]
    assert search(tmp_path, "+craft* +such", sources=["reddit"]) == []


def test_equal_answers_come_as_they_were_written_and_none_is_lost_to_its_thread(
    tmp_path: Path,
) -> None:
    comments = [
        {"comment_id": f"c{n:03d}", "post_id": "p0", "parent_id": "t3_p0", "body": "an elm elm"}
        for n in range(300)
    ]
    posts(tmp_path, "oak", *["an elm stands there"] * 30)
    write(tmp_path, "reddit/comments", comments)
    index(run_at(tmp_path))
    answers = search(tmp_path, "elm", sources=["reddit"], only=Only(limit=20))
    assert answers[0].key.startswith("t1_c")  # of which only one is taken
    keys = [one.key for one in answers[1:]]
    assert len(keys) == 19
    assert keys == [one.key for one in search(tmp_path, "elm", only=Only(limit=20))][1:]
    assert len(search(tmp_path, "elm", only=EVERY)) == 330
    assert len(search(tmp_path, "elm", only=Only(each=None, limit=10**9))) == 330


@given(st.text(max_size=60))
@example('"')
@example('" " ""')
@example("NEAR(a b, 3) AND text:x OR NOT *")
@example("title : wolf ^ + - -- {}")
@example('\x00\ud800\u0301 * a*b -"c" +')
@example("'; DROP TABLE passages; --")
@example("-wolf")
def test_only_a_text_without_words_is_an_error(made: Path, text: str) -> None:
    try:
        answers = search(made, text, sources=["wiki"])
    except UsageError:
        assert not re.search(r"(?:^|\s)[a-zA-Z0-9]", text)
        return
    for one in answers:
        assert one.score > 0
        assert one.url.startswith("https://")


def test_no_passage_is_long(tmp_path: Path) -> None:
    text = " ".join(f"word{n}" for n in range(5000))
    cues = [{"start_s": 0.0, "duration_s": 500.0, "text": text}]
    write(tmp_path, "youtube/videos", [{"video_id": "v", "title": "t", "description": text}])
    write(tmp_path, "youtube/transcripts", [{"video_id": "v", "kind": "asr", "cues": cues}])
    index(run_at(tmp_path))
    (one,) = search(tmp_path, "word2400", only=Only(kinds=("transcript",)))
    assert len(one.text.split()) <= MOST
    assert one.url.endswith("v=v&t=240s")
    (one,) = search(tmp_path, "word4999", only=Only(kinds=("video",)))
    assert len(one.text.split()) <= MOST_WORDS


def files_of(folder: Path) -> dict[str, bytes]:
    """What an index holds; its note says when that was written."""
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def bytes_of(folder: Path) -> bytes:
    return b"".join(files_of(folder).values())


def made_at(root: Path) -> dict[str, int]:
    return {source: ARTIFACTS[f"index/{source}"].manifest(root).stat().st_ino for source in SOURCES}


def test_a_changed_source_is_made_again_and_no_other(root: Path) -> None:
    run = run_at(root)
    assert index(run)["indexed"] == []
    Layout(root).rows("wiki/pages")[0].touch()  # the same bytes
    assert index(run)["indexed"] == []
    assert SECRET.encode() in bytes_of(Layout(root).index("reddit"))
    before = made_at(root)
    keep = pq.read_table(Layout(root).rows("reddit/posts")[0]).slice(1).to_pylist()
    write(root, "reddit/posts", keep)
    with pytest.raises(UsageError, match="index of reddit is missing or out of date") as caught:
        search(root, "camel")
    assert caught.value.hint == "run `kb index`"
    assert search(root, "camel", sources=["wiki"])
    assert index(run)["indexed"] == ["reddit"]
    now = made_at(root)
    assert {source for source in SOURCES if now[source] != before[source]} == {"reddit"}
    assert SECRET.encode() not in bytes_of(Layout(root).index("reddit"))
    assert {one.source for one in search(root, SECRET)} == {"youtube", "wiki"}


def test_a_filter_removes_an_index_that_it_made_old_and_leaves_another(tmp_path: Path) -> None:
    root = tmp_path / "data"
    full_root.make(root)
    run = run_at(root)
    index(run)
    held = Layout(root).index("youtube")
    run_clean(run, "youtube")
    assert ARTIFACTS["index/youtube"].manifest(root).is_file()
    views = run.profile.section("youtube").min_views
    run_clean(run_at(root, min_views=views + 10**9), "youtube")
    assert not held.exists()


def test_a_run_of_words_ranks_above_passages_that_only_share_them(tmp_path: Path) -> None:
    run = "the wolf sleeps beside a small red door"
    shuffled = [
        "door door red red small small beside wolf wolf a sleeps the",
        "a small red wolf is beside the door and sleeps. The red door is small",
    ]
    posts(tmp_path, *shuffled, f"{'many words before it ' * 5} {run} {'and after ' * 5}")
    index(run_at(tmp_path))
    (first, *others) = search(tmp_path, run, only=Only(limit=3))
    assert run in first.text
    assert "**the wolf sleeps beside a small red door**" in first.snippet
    assert {one.text for one in others} == set(shuffled)
    assert first.score > 1.5 * others[0].score
    # A part of it counts too, as a window may end in the middle of a sentence.
    (first,) = search(tmp_path, "the wolf sleeps beside", only=Only(limit=1))
    (again,) = search(tmp_path, "the wolf sleeps beside gates", only=Only(limit=1))
    assert first.text == again.text


def test_a_purge_leaves_no_byte_and_searches_follow(root: Path, here: Here, tmp_path: Path) -> None:
    source = "youtube"
    held = Layout(root).index(source)
    assert SECRET.encode() in bytes_of(held)
    (tmp_path / "ids.txt").write_text(video_id(0))
    at = ("--data", str(root), "--profile", "minecraft")
    planned = here("purge", source, "--ids", str(tmp_path / "ids.txt"), "--plan", "--json", *at)
    assert "index/youtube" in {
        line["folder"] for line in json.loads(planned.out.splitlines()[-1])["lines"]
    }, planned
    done = here("purge", source, "--ids", str(tmp_path / "ids.txt"), "--workers", "1", *at)
    assert (done.code, "clean/youtube" in done.said) == (1, True)  # there are no raw data
    assert SECRET.encode() not in bytes_of(held)
    others = search(root, SECRET, sources=[one for one in SOURCES if one != source])
    assert len(others) == 2
    done = here("search", SECRET, "--json", *at)
    assert done.code == 0, done.err
    found = json.loads(done.out.splitlines()[-1])["answers"]
    assert {one["source"] for one in found} == set(SOURCES) - {source}


def test_what_a_killed_index_left_goes_with_the_next_lock(root: Path) -> None:
    left = Layout(root).index("wiki").with_name(".wiki.new")
    (left / "parts").mkdir(parents=True)
    (left / "parts" / "0.store").write_text(SECRET)
    with lock.taking(root, *lock.of_purge("youtube")):
        assert left.exists()  # another source's
    with lock.taking(root, *lock.of_purge("wiki")):
        assert not left.exists()
    assert search(root, "camel", sources=["wiki"])


def test_search_in_python(root: Path) -> None:
    data = kb.load(root)
    found = data.search("how to ride the camel", source="wiki", limit=3)
    assert found.to_pandas()["url"][0] == "https://wiki.example/w/Camel?oldid=1004#Ways_to_ride"
    assert len(found) == 3
    assert data.search("nowhere").to_table().schema == found.schema
    with pytest.raises(UsageError, match="no word to search for"):
        data.search("(((")
    assert all(row["kind"] == "table" for row in data.search("leather", kind="table"))
    with pytest.raises(UsageError, match="unknown kind 'tabel'"):
        data.search("leather", kind="tabel")
    index_of.remove(root, "wiki")
    assert data.search("camel", source="wiki").to_pylist()  # it is made first


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


SPOIL = [flip, lambda path: path.write_bytes(path.read_bytes()[:-9]), Path.unlink]


@pytest.mark.parametrize("spoil", SPOIL)
def test_a_damaged_index_is_told(root: Path, spoil: Callable[[Path], Any]) -> None:
    run, folder = run_at(root), Layout(root).index("wiki")
    kinds = sorted({Path(name).suffix for name in files_of(folder)} - {".lock"})
    for suffix in kinds[SPOIL.index(spoil) :: len(SPOIL)]:  # each kind in one way
        names = files_of(folder).keys() - {MANIFEST, ".managed.json"}
        name = min(name for name in names if name.endswith(suffix))
        assert not verify(root, run.progress).of_kinds("index")
        spoil(folder / name)
        with pytest.raises(DamagedData, match=re.escape(f"wiki/{name} ")) as caught:
            search(root, "camel")
        assert caught.value.hint == "run `kb index --again`"
        (bad,) = verify(root, run.progress).of_kinds("index")
        assert (bad.state, bad.path) == (
            "missing" if spoil is Path.unlink else "damaged",
            folder / name,
        )
        index(run)
        assert search(root, "camel")
    assert not verify(root, run.progress).of_kinds("index")


def test_an_index_without_its_note_or_with_a_file_more(root: Path) -> None:
    run, at = run_at(root), Layout(root)
    (at.index("wiki") / "more.txt").write_text("x")
    (bad,) = verify(root, run.progress).of_kinds("index")
    assert (bad.state, bad.path.name) == ("foreign", "more.txt")
    assert search(root, "camel")
    assert index(run)["indexed"] == ["wiki"]  # no byte stays that is not known
    assert not verify(root, run.progress).of_kinds("index")
    ARTIFACTS["index/wiki"].manifest(root).unlink()
    assert "missing" in {one.state for one in verify(root, run.progress).of_kinds("index")}
    with pytest.raises(UsageError, match="the index of wiki is missing"):
        search(root, "camel")
    assert index(run)["indexed"] == ["wiki"]
    assert not verify(root, run.progress).of_kinds("index")


def term(word: str) -> Any:
    """A term of one word, as `snippet` reads it from an index."""
    return SimpleNamespace(
        words=[word], places=lambda words: [at for at, one in enumerate(words) if one == word]
    )


def test_the_marked_words_are_shown_and_the_rest_is_cut() -> None:
    text = " ".join(["dirt"] * 100 + ["wolf"] + ["sand"] * 100)
    shown, marks = snippet(text, analyzer(""), [term("wolf")])
    assert shown.startswith("…dirt")
    assert shown.endswith("sand…")
    assert "**wolf**" in shown
    assert len(shown.split()) == SNIPPET_WORDS
    assert marks == [(500, 1)]


def test_without_a_mark_the_text_begins() -> None:
    assert snippet("A short\ntext", analyzer(""), [term("wolf")]) == ("A short text", [])
