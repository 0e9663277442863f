"""Questions about what has a page, among threads and videos that say the very same words."""

from pathlib import Path
from typing import Any

import pytest

from kb.search.answers import search, suggest
from kb.search.build import index
from kb.search.ranking import Only
from tests.filters.made import run_at
from tests.search.made import START, write

PAGES = (
    "Obsidian", "Creeper", "Wolf", "Villager", "Nether portal", "Diamond Pickaxe", "Pickaxe",
    "Diamond", "Enchanting", "Potion of Swiftness", "Ender Dragon", "The End", "End", "Elytra",
    "Beacon", "Redstone Torch", "Torch", "Iron Golem", "Iron Farm", "Crafting", "Brewing Stand",
    "Netherite", "Ancient Debris", "Axolotl", "Trading", "Slime", "Slime (block)", "TNT",
    "Jack o'Lantern", "Bed", "Shulker Box", "Totem of Undying", "Debug screen", "Redstone Dust",
    "Sugar Cane", "Mob spawning",
)  # fmt: skip
# What is asked, and the page that is to be among the first three answers of all sources.
QUESTIONS = {
    "how do I make obsidian": "Obsidian",
    "How do you craft an ender-dragon egg?": "Ender Dragon",
    "what does a creeper drop": "Creeper",
    "how do i tame a wolf": "Wolf",
    "How to tame wolves?": "Wolf",
    "what's the best way to breed villagers": "Villager",
    "how to build a nether portal": "Nether portal",
    "where can I find diamonds": "Diamond",
    "which level is best to mine for a diamond pickaxe": "Diamond Pickaxe",
    "What does enchanting do?": "Enchanting",
    "how do I brew a potion of swiftness": "Potion of Swiftness",
    "how do i beat the enderdragon": "Ender Dragon",
    "when do i get to the end": "The End",
    "how do elytra work": "Elytra",
    "why doesn't my beacon work": "Beacon",
    "whats a redstone torch used for": "Redstone Torch",
    "how much iron does an iron golem drop": "Iron Golem",
    "can anyone explain how an iron farm works": "Iron Farm",
    "tutorial for a brewing stand": "Brewing Stand",
    "is netherite better than diamond": "Netherite",
    "where do you get ancient debris": "Ancient Debris",
    "how do I breed axolotls": "Axolotl",
    "tell me about trading with villagers": "Trading",
    "where do slimes spawn": "Slime",
    "how many blocks does TNT destroy": "TNT",
    "how to make a jack o lantern": "Jack o'Lantern",
    "why can't I sleep in a bed": "Bed",
    "what is a shulker box for": "Shulker Box",
    "does a totem of undying save me from the void": "Totem of Undying",
    "how do I open the debug screen": "Debug screen",
    "how fast does sugar cane grow": "Sugar Cane",
    "what stops mob spawning": "Mob spawning",
}
TITLES = {
    "creeper": "Creeper",
    "CREEPERS!": "Creeper",
    "the ender dragon": "Ender Dragon",
    "ender-dragon": "Ender Dragon",
    "enderdragon": "Ender Dragon",
    "slime block": "Slime (block)",
    "jack o’lantern": "Jack o'Lantern",
    "redstone torches": "Redstone Torch",
    "the end": "The End",
    "how to craft": "Crafting",
    "totem undying": "Totem of Undying",
}
ASKED = "How do I keep a creeper out of my base?"  # the title of a thread


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("titles")
    pages, elements = [], []
    for key, title in enumerate(PAGES):
        pages.append(
            {
                "page_id": key,
                "title": title,
                "url": f"https://wiki.example/w/{key}",
                "revision_id": 1,
                "revision_timestamp": START,
            }
        )
        other = PAGES[(key + 7) % len(PAGES)]
        told = (f"The {title} is part of the game.", f"It is found where a {other} is.")
        parts: list[tuple[str, int | None, str]] = [("h1", 1, title), ("p", None, told[0])]
        parts += [("h2", 2, "Obtaining"), ("p", None, f"{told[1]} You can make or get one.")]
        elements += [
            {
                "page_id": key, "element_id": order, "kind": "text", "tag": tag, "text": text,
                "region": "content", "heading_level": level, "visible": True, "folded": False,
                "reading_order": order,
            }
            for order, (tag, level, text) in enumerate(parts)
        ]  # fmt: skip
    posts: list[dict[str, Any]] = []
    comments, videos, transcripts = [], [], []
    for number, words in enumerate((*QUESTIONS, *TITLES, ASKED)):
        post = {"post_id": f"p{number:03d}", "type": "text", "created_utc": START}
        title = ASKED if words == ASKED else f"Thread {number}"
        posts.append({**post, "title": title, "body": f"Well, {words} I asked my brother."})
        comments.append(
            {
                "comment_id": f"c{number:03d}", "post_id": f"p{number:03d}", "created_utc": START,
                "parent_id": f"t3_p{number:03d}", "depth": 0, "body": f"{words} Same here.",
            }
        )  # fmt: skip
        key = f"video{number:06d}"
        cue = {"start_s": 1.0, "duration_s": 3.0, "text": f"so {words} let me show you"}
        videos.append({"video_id": key, "title": f"Episode {number}", "published_at": START})
        transcripts.append({"video_id": key, "kind": "asr", "language": "en", "cues": [cue]})
    for name, rows in {
        "wiki/pages": pages, "wiki/elements": elements, "wiki/cells": [], "wiki/images": [],
        "reddit/posts": posts, "reddit/comments": comments,
        "youtube/videos": videos, "youtube/transcripts": transcripts,
    }.items():  # fmt: skip
        write(root, name, rows)
    index(run_at(root))
    return root


def test_questions_find_the_page_among_the_first_three(root: Path) -> None:
    missed = {}
    for words, title in QUESTIONS.items():
        found = [one.title for one in search(root, words, only=Only(limit=3))]
        if title not in found:
            missed[words] = found
    assert len(missed) <= len(QUESTIONS) - 27, missed
    assert "how do I make obsidian" not in missed


@pytest.mark.parametrize(("words", "title"), TITLES.items())
def test_what_has_the_title_comes_first(root: Path, words: str, title: str) -> None:
    assert search(root, words, only=Only(limit=1))[0].title == title


def test_a_thread_whose_title_is_the_question_comes_first(root: Path) -> None:
    assert search(root, ASKED.lower(), only=Only(limit=1))[0].title == ASKED


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("how do I make obsidan", "how do I make obsidian"),
        ("obsidan zzzqx", ""),  # nothing like it in the index
        ("+obsidan -obsidian", ""),  # which has no answers
    ],
)
def test_a_spelling_is_suggested_that_has_answers(root: Path, typed: str, meant: str) -> None:
    assert suggest(root, typed) == meant
