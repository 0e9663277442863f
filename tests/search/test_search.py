"""`kb index` and `kb search` on a clean world with one right place for each question."""

from __future__ import annotations

import json
import math
import re
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import kb
from kb.core.errors import DamagedData, KbError, UsageError
from kb.core.sources import SOURCES
from kb.filters.clean import run_clean
from kb.search.ask import search
from kb.search.build import index
from kb.search.passage import MOST_WORDS
from kb.search.rank import WEIGHTS, Only
from kb.search.transcripts import LEAST, MOST, talk
from kb.search.words import question
from kb.store import indexed, lock
from kb.store.layout import Layout
from kb.verify.root import verify
from tests.crash import killed
from tests.filters.made import run_at
from tests.inprocess import Here
from tests.search.made import (
    ACTIONS,
    SECRET,
    combinations,
    second,
    told,
    video_id,
    world,
    write,
)

EVERY = Only(each=None, limit=1000)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = world(tmp_path_factory.mktemp("search") / "data")
    index(run_at(root))
    return root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy, the times of its files as well."""
    return Path(shutil.copytree(made, tmp_path / "data"))


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


def brute(passages: list[tuple[str, dict[str, list[str]]]], words: list[str]) -> list[float]:
    """BM25 by its definition: (source, words by field) → scores."""
    total = len(passages)
    scores = []
    for source, fields in passages:
        lengths = [sum(map(len, other.values())) for name, other in passages if name == source]
        mean, length = sum(lengths) / len(lengths), sum(map(len, fields.values()))
        score = 0.0
        for word in words:
            having = sum(any(word in one for one in other.values()) for _, other in passages)
            rarity = math.log(1 + (total - having + 0.5) / (having + 0.5))
            often = sum(WEIGHTS[name] * fields[name].count(word) for name in WEIGHTS)
            score += rarity * often * 2.2 / (often + 1.2 * (0.25 + 0.75 * length / mean))
        scores.append(score)
    return scores


@pytest.mark.parametrize("words", ["camel", "ride camel bones", "nobody camel welcome leather"])
def test_scores_are_those_of_a_reckoning_by_hand(made: Path, words: str) -> None:
    passages, places = [], []
    for source in SOURCES:
        con = sqlite3.connect(Layout(made).index(source))
        names = ", ".join(WEIGHTS)
        for kind, key, *fields in con.execute(
            f"SELECT kind, key, {names} FROM passages ORDER BY id"
        ):
            split = [re.findall(r"\w+", text.lower()) for text in fields]
            passages.append((source, dict(zip(WEIGHTS, split, strict=True))))
            places.append((kind, key, fields[2]))
        con.close()
    wanted = {
        place: pytest.approx(score, rel=1e-5)
        for place, score in zip(places, brute(passages, words.split()), strict=True)
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


@given(st.text(max_size=60))
@example('"')
@example('" " ""')
@example("NEAR(a b, 3) AND text:x OR NOT *")
@example("title : wolf ^ + - -- {}")
@example('\x00\ud800\u0301 * a*b -"c" +')
@example("'; DROP TABLE passages; --")
@example("-wolf")
def test_no_text_is_an_error(made: Path, text: str) -> None:
    for one in search(made, text, sources=["wiki"]):
        assert one.score > 0
        assert one.url.startswith("https://")


def test_what_is_typed_becomes() -> None:
    assert [term.match for term in question("how-to 'ride'").terms] == ['"how to"', '"ride"']
    asked = question('wolf "bed rock" craft* +iron -dog -"a b"')
    assert [term.match for term in asked.terms] == ['"wolf"', '"bed rock"', '"craft" *', '"iron"']
    assert asked.needed == ('"bed rock"', '"iron"')
    assert asked.barred == ('"dog"', '"a b"')
    asked = question("How do I tame the wolf?")
    assert [term.match for term in asked.terms] == ['"tame"', '"wolf"']
    assert len(question("how to").terms) == 2
    assert len(question('+how "to the" wolf').terms) == 3
    assert question("x" + " y z" * 100).terms == question("x y z").terms
    assert len(question(" ".join(map(str, range(100)))).terms) == 32


def test_windows_end_where_the_talk_pauses() -> None:
    words = " ".join(["word"] * 10)
    starts = [0.0, 3, 6, 9, 12, 15, 18, 25, 28, 31, 34, 37, 40, 43, 46, 49]
    said = talk(starts, [3.0] * 16, [words] * 16)
    found = list(said.windows())
    assert [starts[begin] for begin, _ in found] == [0.0, 25]  # before the pause from 21 to 25
    assert [n for begin, after in found for n in range(begin, after)] == list(range(16))
    text, times = said.joined(*found[1])
    assert [(text[at : at + 4], second) for at, second in times] == [
        ("word", start) for start in starts[7:]
    ]
    even = talk([3.0 * n for n in range(100)], [3.0] * 100, [words] * 100).windows()
    sizes = [10 * (after - begin) for begin, after in even]
    assert sum(sizes) == 1000
    assert all(LEAST <= size <= MOST for size in sizes[:-1])


def test_cues_without_words_or_times_and_of_too_many_words() -> None:
    said = talk(
        [None, 1.0, -5.0, 20.0], [None, 2.0, 1.0, 10.0], ["", None, "a\nb ", "x " * (MOST + 1)]
    )
    assert said.texts[0] == "a b"
    assert [len(text.split()) for text in said.texts] == [2, MOST, 1]
    assert said.starts == [0.0, 20.0, pytest.approx(20 + 10 * MOST / (MOST + 1))]
    assert said.ends[-1] == 30.0
    assert list(talk([], [], []).windows()) == []


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


def bytes_of(root: Path) -> bytes:
    return b"".join(path.read_bytes() for path in sorted(Layout(root).indexes.rglob("*")))


def test_a_changed_source_is_made_again_and_no_other(root: Path) -> None:
    run = run_at(root)
    times = {source: Layout(root).index(source).stat().st_mtime_ns for source in SOURCES}
    assert index(run)["indexed"] == []
    Layout(root).rows("wiki/pages")[0].touch()  # the same bytes
    assert index(run)["indexed"] == []
    assert SECRET.encode() in bytes_of(root)
    keep = pq.read_table(Layout(root).rows("reddit/posts")[0]).slice(1).to_pylist()
    write(root, "reddit/posts", keep)
    with pytest.raises(UsageError, match="older than clean/reddit") as caught:
        search(root, "camel")
    assert caught.value.hint == "run `kb index`"
    assert search(root, "camel", sources=["wiki"])
    assert index(run)["indexed"] == ["reddit"]
    now = {source: Layout(root).index(source).stat().st_mtime_ns for source in SOURCES}
    assert {source for source in SOURCES if now[source] != times[source]} == {"reddit"}
    assert {one.source for one in search(root, SECRET)} == {"youtube", "wiki"}


def test_a_filter_removes_an_index_that_it_made_old_and_leaves_another(tmp_path: Path) -> None:
    root = tmp_path / "data"
    killed.make(root)
    run = run_at(root)
    index(run)
    held = Layout(root).index("youtube")
    run_clean(run, "youtube")
    assert held.is_file()
    views = run.profile.section("youtube").min_views
    run_clean(run_at(root, min_views=views + 10**9), "youtube")
    assert not held.exists()


def test_the_same_rows_give_the_same_bytes(root: Path, made: Path) -> None:
    shutil.rmtree(Layout(root).indexes)
    index(run_at(root))
    for source in SOURCES:
        first, again = (Layout(one).index(source).read_bytes() for one in (made, root))
        assert first == again


def test_a_purge_leaves_no_byte_and_the_next_search_follows(
    root: Path, here: Here, tmp_path: Path
) -> None:
    source = "youtube"
    held = Layout(root).index(source)
    assert SECRET.encode() in held.read_bytes()
    (tmp_path / "ids.txt").write_text(video_id(0))
    at = ("--data", str(root), "--profile", "minecraft")
    planned = here("purge", source, "--ids", str(tmp_path / "ids.txt"), "--plan", "--json", *at)
    assert "index" in {
        line["folder"] for line in json.loads(planned.out.splitlines()[-1])["lines"]
    }, planned
    done = here("purge", source, "--ids", str(tmp_path / "ids.txt"), "--workers", "1", *at)
    assert done.code == 0, done.err
    assert not held.exists()
    others = search(root, SECRET, sources=[one for one in SOURCES if one != source])
    assert len(others) == 2
    done = here("search", SECRET, "--json", *at)
    assert done.code == 0, done.err
    found = json.loads(done.out.splitlines()[-1])["answers"]
    assert {one["source"] for one in found} == set(SOURCES) - {source}
    assert held.is_file()
    assert SECRET.encode() not in held.read_bytes()


def test_what_a_killed_index_left_goes_with_the_next_lock(root: Path) -> None:
    left = Layout(root).index("wiki").with_name(".wiki.sqlite.1-2-abc.tmp")
    left.write_text(SECRET)
    with lock.taking(root, *lock.of_purge("youtube")):
        assert left.exists()  # another source's
    with lock.taking(root, *lock.of_purge("wiki")):
        assert not left.exists()
    assert Layout(root).index("wiki").is_file()


def test_search_as_it_is_typed(root: Path, here: Here) -> None:
    shutil.rmtree(Layout(root).indexes)
    at = ("--data", str(root))
    done = here("search", "ride", "the", "camel", "--source", "wiki", *at)
    assert done.code == 0, done.err
    assert "Camel › Ways to ride (wiki section, 2023-01-05, CC-BY-SA-3.0, score " in done.out
    assert "https://wiki.example/w/Camel?oldid=1004#Ways_to_ride" in done.out
    assert "**ride** the **camel**" in done.out
    assert "no index of wiki" in done.err
    assert not Layout(root).index("youtube").exists()  # nobody asked for it
    done = here("index", "--json", *at)
    assert json.loads(done.out.splitlines()[-1])["indexed"] == ["reddit", "youtube"]
    done = here("search", "camel", "--json", "--limit", "4", "--size", "30", *at)
    answers = json.loads(done.out.splitlines()[-1])["answers"]
    assert len(answers) == 4
    assert all(len(one["text"]) <= 30 for one in answers)
    done = here("search", "(((", *at)
    assert (done.code, done.out) == (0, "")
    assert "no answers" in done.err
    done = here("search", "camel", "--since", "tomorrow", *at)
    assert (done.code, done.said) == (2, "kb: --since is 'tomorrow'; write it like 2023-01-31")
    done = here("index", "--data", str(root / "nowhere"))
    assert done.code == 2
    done = here("search", "camel", "--data", str(root / "nowhere"))
    assert done.code == 2
    assert "nothing to search" in done.said
    with lock.taking(root, "wiki"):
        assert here("search", "camel", *at).code == 0


def test_search_in_python(root: Path) -> None:
    data = kb.load(root)
    found = data.search("how to ride the camel", source="wiki", limit=3)
    assert found.to_pandas()["url"][0] == "https://wiki.example/w/Camel?oldid=1004#Ways_to_ride"
    assert len(found) == 3
    assert data.search("(((").to_table().schema == found.schema
    assert all(row["kind"] == "table" for row in data.search("leather", kind="table"))
    with pytest.raises(UsageError, match="no kind 'tabel'"):
        data.search("leather", kind="tabel")
    indexed.forget(root, "wiki")
    with pytest.raises(KbError, match="the index of wiki is not there") as caught:
        data.search("camel")
    assert caught.value.hint == "run `kb index`"


def break_index(path: Path) -> None:
    data = bytearray(path.read_bytes())
    for at in range(4096, len(data), 4096):
        data[at : at + 200] = b"\xff" * 200
    path.write_bytes(data)


def flip_index(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b"camel")] ^= 1
    path.write_bytes(data)


SPOIL = [flip_index, break_index, lambda path: path.write_bytes(b"no database" * 99)]


@pytest.mark.parametrize("spoil", SPOIL)
def test_a_damaged_index_is_told(root: Path, spoil: Callable[[Path], Any]) -> None:
    assert not verify(root, run_at(root).progress).of("index")
    spoil(Layout(root).index("wiki"))
    with pytest.raises(DamagedData, match=r"wiki\.sqlite can't be read") as caught:
        search(root, "camel")
    assert caught.value.hint == "run `kb index --again`"
    (bad,) = verify(root, run_at(root).progress).of("index")
    assert (bad.state, bad.path) == ("damaged", Layout(root).index("wiki"))
    index(run_at(root))
    assert search(root, "camel")
    assert not verify(root, run_at(root).progress).of("index")
