"""Questions in several languages and scripts: function words do not rank, and words are found where
no spaces are.
"""

from pathlib import Path
from typing import Any

import pytest

from kb.search.answers import search, search_as_meant
from kb.search.build import index
from kb.search.passage import MOST_WORDS
from kb.search.ranking import Only
from tests.filters.made import run_at
from tests.search.made import START, write

PAGES = {
    "en": {
        "Diamond": "Diamonds lie deep in the ground.",
        "Obsidian": "Obsidian forms where lava meets water.",
        "Fire": "Fire burns wood and leaps from log to log.",
        "Kiln": "A kiln is heated slowly.",
    },
    "de": {
        "Diamant": "Diamanten liegen tief im Boden.",
        "Obsidian": "Obsidian entsteht, wo Lava auf Wasser trifft.",
        "Ofen": "Der Ofen wird langsam heiß.",
    },
    "ja": {
        "釉薬": "釉薬は窯の中で溶けて、青く光ります。",
        "窯": "窯を開けると、みんなで静かに眺めました。",
        "粘土": "粘土は水で柔らかくします。",
    },
    "th": {"เตาเผา": "เตาเผาร้อนมากเมื่อเปิดตอนกลางคืน", "ดินเหนียว": "ดินเหนียวต้องผสมน้ำก่อนปั้น"},
}
TALK = {
    "en": "How can you find the time? I made it and you can find out how they did what they do",
    "de": "Wie kann man das finden? Wo und warum gibt es so viele, und wer macht was?",
    "ja": "どうやってこれを見ますか。どこで何をしますか。みんなでしました。",
    "th": "ทำอย่างไรและที่ไหนเมื่อไรใครทำอะไร",
}
# A question, and the page that leads its answers.
QUESTIONS = (
    ("en", "How can you find diamonds?", "Diamond"),
    ("en", "what do you do with obsidian", "Obsidian"),
    ("en", "how did they make so much obsidian?", "Obsidian"),
    ("en", "how does fire spread", "Fire"),  # listed as a function word, and a page's name
    ("de", "Wie finde ich Diamanten?", "Diamant"),
    ("de", "Wo und warum entsteht Obsidian", "Obsidian"),
    ("de", "was macht man mit dem Ofen", "Ofen"),
    ("de", "Wofür braucht man viele Diamanten, und wer findet sie?", "Diamant"),
    ("ja", "釉薬はどうやって光りますか", "釉薬"),
    ("ja", "どこで窯を開けますか", "窯"),
    ("ja", "粘土", "粘土"),
    ("ja", "水で柔らかい粘土", "粘土"),
    ("th", "เตาเผาร้อนไหม", "เตาเผา"),
    ("th", "ดินเหนียวต้องทำอย่างไร", "ดินเหนียว"),
)


@pytest.fixture(scope="module")
def roots(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {language: made(tmp_path_factory.mktemp(language), language) for language in PAGES}


def made(root: Path, language: str) -> Path:
    """Pages of a language among threads and videos that are full of its question words."""
    pages: list[dict[str, Any]] = []
    elements: list[dict[str, Any]] = []
    for key, (title, text) in enumerate(PAGES[language].items()):
        own = {"revision_id": 1, "revision_timestamp": START}
        pages.append({"page_id": key, "title": title, "url": f"https://wiki.example/{key}", **own})
        elements.append(
            {
                "page_id": key, "element_id": 1, "kind": "text", "tag": "p", "text": text,
                "region": "content", "visible": True, "folded": False, "reading_order": 1,
            }
        )  # fmt: skip
    posts = [
        {"post_id": f"p{n}", "type": "text", "title": "t", "body": TALK[language]} for n in range(9)
    ]
    cues = [{"start_s": 1.0, "duration_s": 3.0, "text": f"{TALK[language]} " * 60}]
    for name, rows in {
        "wiki/pages": pages, "wiki/elements": elements, "wiki/cells": [], "wiki/images": [],
        "reddit/posts": posts, "reddit/comments": [],
        "youtube/videos": [{"video_id": "v", "title": "t", "published_at": START}],
        "youtube/transcripts": [{"video_id": "v", "kind": "asr", "cues": cues}],
    }.items():  # fmt: skip
        write(root, name, rows)
    index(run_at(root, language=language))
    return root


@pytest.mark.parametrize(("language", "words", "title"), QUESTIONS)
def test_what_a_question_is_about_leads_its_answers(
    roots: dict[str, Path], language: str, words: str, title: str
) -> None:
    (first, *_) = search(roots[language], words, only=Only(limit=3))
    assert first.title == title
    assert "**" in first.snippet


def test_a_misspelt_subject_is_read_as_the_nearest_one(roots: dict[str, Path]) -> None:
    meant = search_as_meant(roots["en"], "how do I made obsidain", only=Only(limit=3))
    assert (meant.suggestion, meant.instead) == ("how do I made obsidian", True)
    assert meant.answers[0].title == "Obsidian"
    meant = search_as_meant(roots["de"], "Wo sind die Diamenten?", only=Only(limit=3))
    assert (meant.answers[0].title, meant.instead) == ("Diamant", True)


def test_passages_and_snippets_without_spaces_are_short(roots: dict[str, Path]) -> None:
    for language in ("ja", "th"):
        found = search(roots[language], TALK[language], only=Only(each=None, limit=100), size=10**6)
        spoken = [one for one in found if one.kind == "transcript"]
        assert len(spoken) > 1
        assert all(len(one.text) <= MOST_WORDS for one in spoken)
        assert all(len(one.snippet) < 150 for one in spoken)
