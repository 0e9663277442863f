"""What people in the invented world say and write:
sentences put together from our own word lists.
"""

from __future__ import annotations

import random

from kb.core import clock

BLOCKS = [
    "oak planks",
    "cobblestone",
    "obsidian",
    "sandstone",
    "glass",
    "spruce logs",
    "stone bricks",
    "white wool",
    "gravel",
    "red sand",
]
ITEMS = [
    "diamond pickaxe",
    "iron sword",
    "crafting table",
    "furnace",
    "bow",
    "shield",
    "bucket of water",
    "torch",
    "fishing rod",
    "map",
]
MOBS = [
    "creeper",
    "zombie",
    "skeleton",
    "spider",
    "enderman",
    "villager",
    "wolf",
    "horse",
    "sheep",
    "chicken",
]
PLACES = [
    "cave",
    "village",
    "desert",
    "forest",
    "ocean",
    "mountain",
    "swamp",
    "mine",
    "nether",
    "river",
]
BUILDS = [
    "house",
    "bridge",
    "tower",
    "farm",
    "storage room",
    "castle wall",
    "railway",
    "harbour",
    "greenhouse",
    "lighthouse",
]
FEELINGS = [
    "so we have to be careful",
    "and that is easier than it looks",
    "which took me all night",
    "and it still surprises me",
    "but there is a better way",
    "so let us do it again",
    "and that is really all there is to it",
]

_SAYINGS = [
    "today we build a {build} out of {block}",
    "first you need a {item}",
    "look at that {mob} over there",
    "we found {block} in the {place}",
    "never dig straight down in a {place}",
    "put the {item} next to the {item2}",
    "the {mob} drops something every time",
    "let us go back to the {place} before night",
    "i placed {block} all around the {build}",
    "this {build} needs more {block}",
    "you craft a {item} with what you have",
    "careful there is a {mob} behind the {build}",
    "i'm going to light the {place} with torches",
    "the {mob} & the {mob2} don't like each other",
    "a {item} makes the {place} much safer",
    "we trade with the {mob} for {block}",
    "and now the roof of the {build}",
    "that is how you tame a {mob}",
    "do you see the {place} behind the {build}",
    "okay that works",
]
_TITLES = [
    "How to Build a {build} | {topic} Episode {n}",
    "{topic} Survival: The {place} and the {mob} (#{n})",
    "{n} Things About the {item} in {topic}",
    "{topic} Guide: {block} for Your {build}",
    "I Spent {n} Days in a {place} - {topic}",
    "{topic} Walkthrough Part {n}: {mob} Trouble",
    "{topic} for Beginners: Your First {item}",
    "The {build} Is Finished! {topic} Let's Play {n}",
]
_PLAIN_TITLES = [  # no topic word in them
    "How to Build a {build}, Episode {n}",
    "The {place} and the {mob} (#{n})",
    "{n} Things About the {item}",
    "My {build} Out of {block}, Part {n}",
]
_ABOUT = [
    "In this episode we build a {build} out of {block}.",
    "Watch out for the {mob} in the {place}.",
    "Everything you need: a {item} and some {block}.",
    "Recorded in one evening.",
    "The seed of this world is {n}.",
    "Thank you for watching.",
    "Next time: the {place}.",
]
_FOREIGN = {
    "de": [
        "heute bauen wir ein Haus am Fluss",
        "zuerst brauchen wir eine Spitzhacke",
        "passt auf, da ist ein Zombie",
        "das Dach kommt als Letztes",
    ],
    "es": [
        "hoy vamos a construir una casa",
        "primero necesitamos un pico",
        "cuidado con el zombi",
        "el techo va al final",
    ],
    "ja": ["今日は家を作ります", "まずツルハシが必要です", "ゾンビに気をつけて", "最後に屋根です"],
}


def fill(template: str, rng: random.Random, topic: str) -> str:
    """A template with words chosen by `rng`."""
    return template.format(
        topic=topic,
        n=rng.randint(2, 99),
        build=rng.choice(BUILDS),
        block=rng.choice(BLOCKS),
        item=rng.choice(ITEMS),
        item2=rng.choice(ITEMS),
        mob=rng.choice(MOBS),
        mob2=rng.choice(MOBS),
        place=rng.choice(PLACES),
    )


def title(rng: random.Random, topic: str) -> str:
    """A video's title with the topic in it."""
    return _cased(fill(rng.choice(_TITLES), rng, topic))


def plain_title(rng: random.Random) -> str:
    """A title that doesn't name the topic."""
    return _cased(fill(rng.choice(_PLAIN_TITLES), rng, ""))


def about(rng: random.Random, sentences: int = 3) -> str:
    """A description without the topic's name."""
    return "\n".join(fill(rng.choice(_ABOUT), rng, "") for _ in range(sentences))


def sentence(rng: random.Random, language: str) -> str:
    """Something said in a video."""
    if language in _FOREIGN:
        return rng.choice(_FOREIGN[language])
    said = fill(rng.choice(_SAYINGS), rng, "")
    return f"{said} {rng.choice(FEELINGS)}" if rng.random() < 0.3 else said


def cues(
    rng: random.Random, language: str, seconds: float, *, rolling: bool
) -> list[tuple[float, float, str]]:
    """(start s, duration s, text) of a caption track.

    `rolling`: as automatic captions are, five to seven words a cue, each shown until the next but
    one begins; otherwise whole sentences one after the other.
    """
    made: list[tuple[float, float, str]] = []
    clock, end = round(rng.uniform(0.1, 2.0), 2), min(seconds, 120.0)
    while clock < end - 3:
        if rng.random() < 0.04:
            made.append((clock, 2.5, "[Music]"))
            clock = round(clock + 2.5, 2)
            continue
        words = sentence(rng, language).split()
        size = rng.randint(5, 7) if rolling else len(words)
        for at in range(0, len(words), size):
            piece = words[at : at + size]
            length = round(0.4 + 0.38 * len(piece), 2)
            made.append((clock, round(length * (1.9 if rolling else 1.0), 2), " ".join(piece)))
            clock = round(clock + length, 2)
        clock = round(clock + rng.uniform(0.0, 0.8), 2)
    return made


def examples(count: int) -> list[str]:
    """Things that are said and written in the world, in lower case; the same each time."""
    rng = clock.rng("examples of speech")
    kinds = (
        lambda: about(rng, rng.randint(1, 2)).replace("\n", " "),
        lambda: title(rng, "Minecraft"),
        lambda: plain_title(rng),
        lambda: sentence(rng, "en"),
    )
    return [rng.choice(kinds)().lower() for _ in range(count)]


def _cased(text: str) -> str:
    return " ".join(word[:1].upper() + word[1:] for word in text.split())
