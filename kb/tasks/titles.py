"""Titles → prompts.

A title is cut into parts at punctuation, and channel talk is removed. The first part that begins
with a verb of the profile, after an optional lead-in ("how to"), gives the prompt. Else a part that
ends with a thing of the profile does, with the thing's verb, if the title, or that of a playlist
with the video, shows that it is made:

    "🔥 How to Build an EASY Iron Farm in Minecraft! (Tutorial) #12"  →  "build an easy iron farm"
    "Villager trading hall guide"                                  →  "build villager trading hall"
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from kb.core.config.profile.products import Tasks
from kb.pairs.keyword_list import singular

NO_VERB, NO_OBJECT, TOO_LONG = "no_verb", "no_object", "too_long"
NOT_A_TASK, DUPLICATE, JUDGED, UNLISTED = "not_a_task", "duplicate", "judged", "no_playlist"
_NEAREST = (NOT_A_TASK, TOO_LONG, NO_OBJECT, NO_VERB)  # the decisive one of several reasons first

# Emoji and other symbols, what changes their form, and control characters.
_PICTURES = {"So", "Sk", "Sc", "Cc", "Cf", "Cs", "Co", "Me"}
_BRACKETS = re.compile(r"\([^()]*\)|\[[^][]*\]|\{[^{}]*\}|【[^】]*】|《[^》]*》")
_HASHTAG = re.compile(r"#\w+|https?://\S+|\bv?\d+\.\d+(?:\.\d+)*\+?")  # versions too
_PARTS = re.compile(r"[|:;!?,\"“”„~•·…]+|\.{2,}|\.(?:\s|$)|\s[-–—/]+\s|\s/|/\s")
_NUMBERING = re.compile(r"^\W*\d+\s*[.)]\s+")
_LONGEST_THING = 6  # words
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
        self._things = {tuple(_words(name)): verb for name, verb in rules.things.items()}
        self._shown = re.compile(rf"(?<!\w)(?:{_any_of(rules.marks)})(?!\w)")
        self._praise = re.compile(rf"(?:{_any_of(rules.praise)})(?!\w)")
        self._owners = set(rules.owners)
        self._nouns, self._endings = set(rules.nouns), set(rules.endings)
        self._named = {words[0] for one in names if (words := _words(one))}

    def teaches(self, title: str) -> bool:
        """Whether a title says that something is shown how it is made."""
        return bool(self._shown.search(unicodedata.normalize("NFKC", title).lower()))

    def mine(self, title: str, *, taught: bool = False) -> MinedTitle:
        """The task that a title names, or why it names none. `taught`: that it shows how a thing is
        made is known.
        """
        shown = taught or self.teaches(title)
        rejected, made = [], []
        for part in _PARTS.split(_plain(title)):
            words = _words(self._talk.sub(" ", _NUMBERING.sub("", part)))
            mined = self._of_part(words)
            if not mined.reasons:
                return mined
            rejected.append(mined)
            if thing := self._of_thing(words, shown):
                made.append(thing)
        if made:
            return made[0]
        best = min(rejected, key=lambda one: _NEAREST.index(one.reasons[0]))
        every = {reason for one in rejected for reason in one.reasons}
        return best._replace(reasons=tuple(one for one in _NEAREST if one in every))

    def _of_part(self, words: list[str]) -> MinedTitle:
        line, lead = self._without_lead_in(words)
        verb, _, rest = line.partition(" ")
        if verb not in self._forms or self._name.match(line):
            return MinedTitle("", (), (NO_VERB,))
        behind = rest.split()
        if not lead and verb in self._nouns and not self._is_verb_before(behind):
            return MinedTitle("", (), (NO_VERB,))
        if (
            behind[:1]
            and behind[0] in self._owners
            and self._thing_of(self._object(self._trimmed(behind)))
        ):
            behind = behind[1:]  # whose the thing is does not matter
        after = self._trimmed(behind)
        objects = self._object(after)
        prompt = " ".join([self._forms[verb], *after])
        if not objects:
            return MinedTitle("", (), (NO_OBJECT,))
        if self._never.search(" ".join([verb, *behind])):
            return MinedTitle(prompt, objects, (NOT_A_TASK,))
        too_long = len(after) >= self._max_words
        return MinedTitle(prompt, objects, (TOO_LONG,) if too_long else ())

    def _without_lead_in(self, words: list[str]) -> tuple[str, bool]:
        line = " ".join(words)
        lead = self._lead_in.match(line)
        return (line[lead.end() :], True) if lead else (line, False)

    def _trimmed(self, words: list[str]) -> list[str]:
        """Without words that say nothing at the end; one that is the whole object stays."""
        empty = self._joints | self._fillers
        while words and (
            words[-1] in empty
            or ((words[-1] in self._endings or words[-1].isdigit()) and self._object(words[:-1]))
        ):
            words = words[:-1]
        return [] if all(word.isdigit() for word in words) else words

    def _is_verb_before(self, words: list[str]) -> bool:
        """Whether a word that is rather a noun is a verb here: "farm the iron", "farm iron", but
        not "farm tour" and "farm house".
        """
        first = words[:1]
        named = bool(self._named & {*first, *map(singular, first)})
        return bool(self._fillers.intersection(first)) or (named and not self._thing_of(first))

    def _thing_of(self, words: Sequence[str]) -> str:
        """The verb of the thing that these words end with; "" where they end with none."""
        ends = (tuple(words[place:]) for place in range(len(words)))  # longer ones first
        return next((self._things[end] for end in ends if end in self._things), "")

    def _of_thing(self, words: list[str], shown: bool) -> MinedTitle | None:
        """The prompt of a part of two to six words that names a thing, where the title says that it
        is shown how it is made, or praises it.
        """
        line, _ = self._without_lead_in(words)
        named = line.split()
        while named and named[0] in self._joints | self._fillers | self._owners:
            named = named[1:]
        named = self._trimmed(named)
        objects, verb = self._object(named), self._thing_of(self._object(named))
        if (
            not verb
            or not 2 <= len(named) <= _LONGEST_THING
            or not (shown or self._praise.match(" ".join(named)))
            or self._never.search(" ".join(named))
            or tuple(named[: len(objects)]) != objects  # an article in it: a sentence
            or any(word.isdigit() for word in objects)
        ):
            return None
        return MinedTitle(" ".join([verb, *named]), objects, ())

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
