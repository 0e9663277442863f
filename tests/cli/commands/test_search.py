"""Tests of `kb index` and `kb search` at the command line."""

import json
import shutil
from pathlib import Path

from kb.store import lock
from kb.store.layout import Layout
from tests.inprocess import Here
from tests.search.conftest import made, root  # noqa: F401  fixtures


def test_search_as_it_is_typed(root: Path, here: Here) -> None:  # noqa: F811
    shutil.rmtree(Layout(root).indexes)
    at = ("--data", str(root))
    done = here("search", "ride", "the", "camel", "--source", "wiki", *at)
    assert done.code == 0, done.err
    assert " 1. Camel › Ways to ride\n" in done.out
    assert "source: wiki section · date: 2023-01-05 · licence: CC-BY-SA-3.0 · score: " in done.out
    assert "https://wiki.example/w/Camel?oldid=1004#Ways_to_ride" in done.out
    assert "**ride the camel**" in done.out
    assert "the index of wiki is missing or out of date" in done.err
    assert not Layout(root).index("youtube").exists()  # nobody asked for it
    done = here("index", "--json", *at)
    assert json.loads(done.out.splitlines()[-1])["indexed"] == ["reddit", "youtube"]
    done = here("search", "camel", "--json", "--limit", "4", "--size", "30", *at)
    answers = json.loads(done.out.splitlines()[-1])["answers"]
    assert len(answers) == 4
    assert all(len(one["text"]) <= 30 for one in answers)
    for words in ("", " ", "((("):
        done = here("search", words, *at)
        assert (done.code, done.out) == (2, "")
        assert f"the query {words!r} contains no word to search for" in done.said
    done = here("search", "camle", *at)
    assert done.code == 0
    assert "**camel**" in done.out
    assert 'nothing has these words; read as "camel"' in done.err
    done = here("search", "camle", "--json", *at)
    assert json.loads(done.out.splitlines()[-1])["suggestion"] == "camel"
    done = here("search", "camel", "--since", "tomorrow", *at)
    assert (done.code, done.said) == (2, "kb: --since is 'tomorrow'; write it like 2023-01-31")
    done = here("index", "--data", str(root / "nowhere"))
    assert done.code == 2
    done = here("search", "camel", "--data", str(root / "nowhere"))
    assert (done.code, "there is no data root" in done.said) == (2, True)
    with lock.taking(root, "wiki"):
        assert here("search", "camel", *at).code == 0
