"""Titles → prompts.

A title is cut into parts at punctuation, and channel talk is removed. The first part that begins
with a verb of the profile, after an optional lead-in ("how to"), gives the prompt:

    "🔥 How to Build an EASY Iron Farm in Minecraft! (Tutorial) #12"  →  "build an easy iron farm"
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import NamedTuple

from kb.core.config.profile.products import Tasks

NO_VERB, NO_OBJECT, TOO_LONG = "no_verb", "no_object", "too_long"
NOT_A_TASK, DUPLICATE = "not_a_task", "duplicate"
_NEAREST = (NOT_A_TASK, TOO_LONG, NO_OBJECT, NO_VERB)  # the decisive one of several reasons first

# Emoji and other symbols, what changes their form, and control characters.
_PICTURES = {"So", "Sk", "Sc", "Cc", "Cf", "Cs", "Co", "Me"}
_BRACKETS = re.compile(r"\([^()]*\)|\[[^][]*\]|\{[^{}]*\}|【[^】]*】|《[^》]*》")
_HASHTAG = re.compile(r"#\w+|https?://\S+|\bv?\d+\.\d+(?:\.\d+)*\+?")  # versions too
_PARTS = re.compile(r"[|:;!?,\"“”„~•·…]+|\.{2,}|\.(?:\s|$)|\s[-–—/]+\s|\s/|/\s")
_NUMBERING = re.compile(r"^\W*\d+\s*[.)]\s+")
_WORD = re.compile(r"[^\W_]+(?:['’&+-]+[^\W_]+)*")


class MinedTitle(NamedTuple):
    """`prompt`: of the title, "" where it has none; `object`: the words that name what the task is
    about; `reasons`: why it is no task, the decisive one first, () for a task.
    """

    prompt: str
    object: tuple[str, ...]
    reasons: tuple[str, ...]


class TitleMiner:
    """Mines titles by the lists of a profile. `topics`: words of the domain, which every title may
    have and no prompt needs. `names`: of things, as "Crafting Table" is none that somebody crafts.
    """

    def __init__(self, rules: Tasks, topics: Iterable[str], names: Iterable[str] = ()) -> None:
        self._forms = {form: forms[0] for forms in map(_words, rules.verbs) for form in forms}
        with_verb = [
            one for one in names if len(words := _words(one)) > 1 and words[0] in self._forms
        ]
        self._name = re.compile(rf"(?:{_any_of(with_verb)})(?!\w)" if with_verb else r"(?!)")
        joints = _any_of(rules.joints)
        # Of a topic such as "how to cook" the verb has to stay.
        free = [one for one in topics if not self._forms.keys() & _words(one)]
        talk = _any_of(rules.talk, *(rf"(?:(?:{joints})\W+)?{_phrase(one)}" for one in free))
        self._talk = re.compile(rf"(?<!\w)(?:{talk})(?!\w)")
        self._lead_in = re.compile(rf"(?:(?:{_any_of(rules.lead_ins)})\s+)+")
        self._never = re.compile(rf"(?<!\w)(?:{_any_of(rules.never)})(?!\w)")
        self._fillers, self._joints = set(rules.fillers), set(rules.joints)
        self._max_words = rules.max_words

    def mine(self, title: str) -> MinedTitle:
        """The task that a title names, or why it names none."""
        rejected = []
        for part in _PARTS.split(_plain(title)):
            words = _words(self._talk.sub(" ", _NUMBERING.sub("", part)))
            mined = self._of_part(words)
            if not mined.reasons:
                return mined
            rejected.append(mined)
        best = min(rejected, key=lambda one: _NEAREST.index(one.reasons[0]))
        every = {reason for one in rejected for reason in one.reasons}
        return best._replace(reasons=tuple(one for one in _NEAREST if one in every))

    def _of_part(self, words: list[str]) -> MinedTitle:
        line = " ".join(words)
        line = line[lead.end() :] if (lead := self._lead_in.match(line)) else line
        verb, _, rest = line.partition(" ")
        if verb not in self._forms or self._name.match(line):
            return MinedTitle("", (), (NO_VERB,))
        after = rest.split()
        while after and after[-1] in self._joints | self._fillers:
            after.pop()
        objects = self._object(after)
        prompt = " ".join([self._forms[verb], *after])
        if not objects:
            return MinedTitle("", (), (NO_OBJECT,))
        if self._never.search(rest):
            return MinedTitle(prompt, objects, (NOT_A_TASK,))
        too_long = len(after) >= self._max_words
        return MinedTitle(prompt, objects, (TOO_LONG,) if too_long else ())

    def _object(self, words: list[str]) -> tuple[str, ...]:
        """The words up to the first joint, without fillers; of "build and decorate a house" those
        after the second verb.
        """
        if words[:1] and words[0] in self._joints and words[1:2] and words[1] in self._forms:
            words = words[2:]
        until = next((n for n, word in enumerate(words) if word in self._joints), len(words))
        return tuple(word for word in words[:until] if word not in self._fillers)

    def plain(self, prompt: str) -> str:
        """A prompt without the words that do not tell two apart."""
        return " ".join(word for word in prompt.split() if word not in self._fillers)


def _plain(title: str) -> str:
    """In lower case, without brackets, hashtags, versions, emoji and control characters."""
    text = unicodedata.normalize("NFKC", title).lower().replace("’", "'")
    previous = ""
    while text != previous:  # brackets in brackets
        previous, text = text, _BRACKETS.sub(" | ", text)
    text = _HASHTAG.sub(" ", text)
    return "".join(
        " " if unicodedata.category(letter) in _PICTURES or letter == "\ufe0f" else letter
        for letter in text
    )


def _words(text: str) -> list[str]:
    return _WORD.findall(text.lower())


def _any_of(phrases: Iterable[str], *patterns: str) -> str:
    """A pattern of phrases and patterns, longer ones first."""
    longest = sorted(phrases, key=len, reverse=True)
    return "|".join([*patterns, *map(_phrase, longest)])


def _phrase(phrase: str) -> str:
    words = phrase.lower().split()
    return r"\W+".join(r"\d+" if word == "#" else re.escape(word) for word in words)
