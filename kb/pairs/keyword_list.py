"""Reads and checks keyword lists, and spells the forms of a keyword.

A tab-separated file with the columns `keyword`, `kind`, `rule`, `forms`; lines that begin with #
are comments. A name is spoken and written in the singular and plural, joined and apart.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

from kb.core import scripts
from kb.core.config.profile.products import Pairs
from kb.core.config.section import (
    ERROR,
    FILL_IN,
    NOTE,
    WARNING,
    Finding,
    is_everyday,
    read_text,
)
from kb.core.errors import ProfileError
from kb.core.suggestions import similar
from kb.pairs.matching import phrase

COLUMNS = ("keyword", "kind", "rule", "forms")
RULES = ("near", "near:WORDS", "topic", "never", "always")
NEVER = -1
_NAMED = 10  # keywords or forms that a finding names
LONGEST = 64  # characters of a phrase, so that it always fits in a text

_SAME = {
    "sheep", "fish", "salmon", "cod", "squid", "deer", "bread", "ice", "sand", "gravel", "lava",
    "water", "dirt", "wool",
}  # fmt: skip
_ODD = {
    "wolf": "wolves",
    "leaf": "leaves",
    "shelf": "shelves",
    "bookshelf": "bookshelves",
    "calf": "calves",
    "ox": "oxen",
    "knife": "knives",
    "half": "halves",
    "mouse": "mice",
    "goose": "geese",
    "foot": "feet",
    "tooth": "teeth",
    "man": "men",
    "potato": "potatoes",
    "tomato": "tomatoes",
    "torch": "torches",
    "loaf": "loaves",
    "hoof": "hooves",
    "cactus": "cacti",
}
# Words that end like "man" and "men" and mean no man.
_NO_MEN = {
    "human", "german", "roman", "norman", "shaman", "talisman", "ottoman", "caiman", "specimen",
    "regimen", "abdomen", "acumen", "bitumen", "stamen", "ramen",
}  # fmt: skip
_SINGULAR = {plural: singular for singular, plural in _ODD.items()}


@dataclass(frozen=True)
class Keyword:
    """`reach`: words around it in which it needs an unmistakable keyword.

    None: it needs none; NEVER: it makes no pair. `more`: forms of its own. `rule`: as written;
    "always" does what an empty one does, and says that an everyday word is meant. With "topic" it
    needs no other in a video whose topic is known.
    """

    name: str
    kind: str
    reach: int | None = None
    more: tuple[str, ...] = ()
    rule: str = field(default="", compare=False)


Row = tuple[int, Keyword]
"""The line that a keyword stands on, counted from 1, and the keyword."""
Problem = tuple[int, str, str]
"""A line that can't be used (0: the whole file can't), what is wrong with it, how to fix it."""


def scan(path: Path, near_words: int) -> tuple[Sequence[Row], Sequence[Problem]]:
    """Every row of a file, and every problem. `near_words` is the reach of a plain `near`."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        return (), ((0, f"the keyword list {path} can't be read: {why}", ""),)
    return _understood(text, near_words)


@lru_cache(maxsize=8)  # a command checks its lists, and then uses them
def _understood(text: str, near_words: int) -> tuple[tuple[Row, ...], tuple[Problem, ...]]:
    rows: list[Row] = []
    problems: list[Problem] = []
    header = False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split("\t")]
        if not header:
            if tuple(cells) != COLUMNS:
                # Without its columns no other line means anything.
                what = f"the first line must read {', '.join(COLUMNS)}, separated by tabs"
                named = sorted(line.replace(",", " ").split()) == sorted(COLUMNS)
                fix = "it has the right names: put tabs between them, in this order"
                return (), ((number, what, fix if named else ""),)
            header = True
            continue
        parsed = _row(cells, near_words)
        if isinstance(parsed, Keyword):
            rows.append((number, parsed))
        else:
            problems.append((number, *parsed))
    return tuple(rows), tuple(problems)


def read_keywords(path: Path, near_words: int) -> list[Keyword]:
    """One keyword file. Raises ProfileError that names the line."""
    rows, problems = scan(path, near_words)
    if problems:
        line, what, fix = problems[0]
        raise ProfileError(f"{path}:{line}: {what}" if line else what, hint=fix)
    return [keyword for _, keyword in rows]


def _row(cells: list[str], near_words: int) -> Keyword | tuple[str, str]:
    """The keyword of a line, or what is wrong with it and how to fix it."""
    needed = "a line has a keyword, a kind, perhaps a rule and forms, separated by tabs"
    if len(cells) < 2:
        return needed, "this one has no tab"
    if len(cells) > len(COLUMNS):
        return needed, f"this one has {len(cells)} columns; commas separate several forms"
    cells = cells + [""] * (len(COLUMNS) - len(cells))
    name, kind, rule, forms = cells
    if FILL_IN in cells:
        return "the line is still to be filled in", "write a keyword and its kind"
    if not name or not kind:
        return needed, f"the {'kind' if name else 'keyword'} of this one is empty"
    folded = phrase(name)
    if not folded or len(folded) > LONGEST:
        wrong = f"more than {LONGEST} letters" if folded else "no word"
        return f"the keyword {name!r} has {wrong}", "write what is said in a video"
    reach = _reach(rule, near_words)
    if isinstance(reach, str):
        return f"the rule is {rule!r}; known: {', '.join(RULES)}, or nothing", reach
    more = tuple(form.strip() for form in forms.split(",") if form.strip())
    return Keyword(name, kind, reach, more, rule)


def _reach(rule: str, near_words: int) -> int | str | None:
    """What a rule means, or how to fix it."""
    name, colon, number = rule.partition(":")
    if rule in ("", "always"):
        return None
    if rule == "never":
        return NEVER
    if rule == "topic" or (name == "near" and not colon):
        return near_words
    if name == "near" and number.isascii() and number.isdigit() and int(number) > 0:
        return int(number)
    if name == "near":
        return "near: is followed by a number of words, such as near:30"
    known = ("topic", "near", "never", "always")
    close = similar(name, known, most=1, cutoff=0.5)
    return f"did you mean {close[0]}?" if close else f"a rule is one of {', '.join(known)}"


class Placed(NamedTuple):
    """A keyword, its file's name and its line."""

    file: str
    line: int
    keyword: Keyword


def check_lists(
    folder: Path,
    names: Sequence[str],
    section: Pairs | None,
    *,
    topic_known: bool = True,
    advice: bool = True,
) -> list[Finding]:
    """Findings of all lists together. `section` is None where [pairs] itself has errors;
    `topic_known`: whether the topic of a video can be known, by a label or by an import. Without
    `advice` only what makes them unusable is looked for, as each command does that needs them.
    """
    near_words = section.near_words if section else Pairs.model_fields["near_words"].default
    every: list[Placed] = []
    findings: list[Finding] = []
    for name in names:
        rows, problems = scan(folder / name, near_words)
        every += [Placed(name, line, keyword) for line, keyword in rows]
        findings += [Finding(ERROR, name, line, "", what, fix) for line, what, fix in problems]
        if not rows and not problems:
            fix = "write one per line: keyword, tab, kind"
            findings.append(Finding(ERROR, name, 0, "", "the list contains no keyword", fix))
    broken = bool(findings)
    if advice:
        findings += _duplicates(every)
        findings += _kinds(every)
        findings += _everyday(every)
        findings += _excluded(every, section)
        findings += _without_spaces(every)
    if advice and not broken:
        findings += _overlapping(every)
    if not broken:
        findings += _unsupported(every, section, topic_known=topic_known)
    return findings


def _at(level: str, place: Placed, what: str, fix: str) -> Finding:
    return Finding(level, place.file, place.line, place.keyword.name, what, fix)


def _duplicates(every: list[Placed]) -> Iterator[Finding]:
    """Names that stand twice, and forms that another keyword has as its name or form."""
    first: dict[str, Placed] = {}
    for place in every:
        name = place.keyword.name
        before = first.setdefault(phrase(name), place)
        if before is not place:
            what = f"{name!r} is already on line {before.line} of {before.file}"
            mine, other = place.keyword, before.keyword
            same = (mine.kind, mine.reach, mine.more) == (other.kind, other.reach, other.more)
            # Only a row that says something else is lost.
            level = NOTE if same else WARNING
            yield _at(level, place, what, "the first counts; take one of them out")
    taken = dict(first)
    for place in every:
        for form in place.keyword.more:
            folded = phrase(form)
            if not folded:
                yield _at(WARNING, place, f"the form {form!r} has no word", "take it out")
                continue
            before = taken.setdefault(folded, place)
            if before is not place:
                what = f"the form {form!r} is that of {before.keyword.name!r} already"
                yield _at(NOTE, place, what, "a form counts for one keyword only")


def _kinds(every: list[Placed]) -> Iterator[Finding]:
    """A kind that stands once and looks like one that stands often."""
    often = Counter(place.keyword.kind for place in every)
    known = [kind for kind, times in often.items() if times >= 3]
    for place in every:
        kind = place.keyword.kind
        if often[kind] > 1:
            continue
        close = similar(kind, known, most=1, cutoff=0.8)
        if close:
            what = f"the kind {kind!r} occurs only once"
            yield _at(WARNING, place, what, f"did you mean {close[0]!r}?")


def _everyday(every: list[Placed]) -> Iterator[Finding]:
    """Single everyday words that count wherever they are said."""
    for place in every:
        keyword = place.keyword
        if keyword.reach is not None or keyword.rule == "always":
            continue
        for word in (keyword.name, *keyword.more):
            if is_everyday(word):
                what = f"{word!r} is an everyday word and has no rule"
                fix = (
                    "write near (with another keyword close by), never, or always (it is meant)"
                    " as its rule"
                )
                yield _at(WARNING, place, what, fix)


def _excluded(every: list[Placed], section: Pairs | None) -> Iterator[Finding]:
    """Keywords that `exclude` takes away whole."""
    named: dict[str, list[Placed]] = {}
    for place in every if section and section.exclude else ():
        named.setdefault(phrase(place.keyword.name), []).append(place)
    for text in section.exclude if section else ():
        excluded = {
            form for alternative in alternatives(text) for form in forms(phrase(alternative))
        }
        for form in sorted(excluded & named.keys()):
            for place in named[form]:
                what = f"{place.keyword.name!r} is ruled out by pairs.exclude"
                yield _at(WARNING, place, what, f"take it out here, or {text!r} there")


def _without_spaces(every: list[Placed]) -> Iterator[Finding]:
    """What matching can't do in scripts that put no spaces between words."""
    for place in every:
        form, rule = phrase(place.keyword.name), place.keyword.rule
        if not any(map(scripts.is_word, form)):
            continue
        if len(form) == 1:
            what = f"{place.keyword.name!r} also counts inside longer words, as no spaces part them"
            yield _at(
                WARNING, place, what, "write words of two signs and more, or never as its rule"
            )
        if rule.startswith("near") or rule == "topic":
            what = (
                f"{rule} counts what stands between two spaces as one word: a whole sentence here"
            )
            yield _at(WARNING, place, what, "write always, or never, as its rule")


def _overlapping(every: list[Placed]) -> Iterator[Finding]:
    """Forms that follow by rule from two keywords, or are another keyword's name or form."""
    owner: dict[str, Placed] = {}
    for place in every:
        for form in (place.keyword.name, *place.keyword.more):
            owner.setdefault(phrase(form), place)
    shared: dict[str, tuple[Placed, Placed]] = {}
    for place in every:
        for form in sorted(forms(phrase(place.keyword.name))):
            first = owner.setdefault(form, place)
            if first.keyword.name != place.keyword.name:
                shared.setdefault(form, (first, place))
    if shared:
        listed = [
            f"{form!r} ({first.keyword.name}, {other.keyword.name})"
            for form, (first, other) in list(shared.items())[:_NAMED]
        ]
        more = ", …" if len(shared) > _NAMED else ""
        count = "1 form overlaps" if len(shared) == 1 else f"{len(shared):,} forms overlap"
        what = f"{count}: {', '.join(listed)}{more}"
        yield _at(
            NOTE,
            next(iter(shared.values()))[1],
            what,
            "a form counts for the keyword that is named first in brackets",
        )


def _unsupported(
    every: list[Placed], section: Pairs | None, *, topic_known: bool
) -> Iterator[Finding]:
    """Rules that wait for a keyword, or a label, that is never there."""
    if not every:
        return
    topical = [place for place in every if place.keyword.rule == "topic"]
    if topical and not topic_known:
        what = f"{_listed(topical)} count only near other keywords: no video's topic is known"
        fix = 'set youtube.game_ids, or youtube.imported_topic = "known" for your own files'
        yield _at(WARNING, topical[0], what, fix)
    if (section and section.include) or any(place.keyword.reach is None for place in every):
        return
    fix = "near needs keywords without a rule nearby: leave the rule empty for unmistakable words"
    if not topical or not topic_known:
        yield _at(ERROR, every[0], "every keyword has a rule, so none can make a pair", fix)
    elif near := [place for place in every if place.keyword.rule.startswith("near")]:
        yield _at(WARNING, near[0], f"no keyword supports {_listed(near)}", fix)


def _listed(places: list[Placed]) -> str:
    """The first names, and how many more there are."""
    names = ", ".join(repr(place.keyword.name) for place in places[:_NAMED])
    more = len(places) - _NAMED
    return f"{names} and {more:,} more" if more > 0 else names


def alternatives(text: str) -> list[str]:
    """Phrases of which a slash parts words: "bed/chest day" is "bed day" and "chest day"."""
    return [" ".join(words) for words in product(*(word.split("/") for word in text.split()))]


def plural(word: str) -> str:
    """ "berry" → "berries", "torch" → "torches", "wolf" → "wolves", "snowman" → "snowmen"; plurals
    and mass nouns stay.
    """
    if word in _SAME or word in _SINGULAR or not (word[-1:].isalpha() and word[:1].isascii()):
        return word
    if word in _ODD:
        return _ODD[word]
    if word.endswith("man") and len(word) > 3 and word not in _NO_MEN:
        return word[:-2] + "en"
    if word.endswith(("s", "x", "z", "ch", "sh")):
        return word if word.endswith("s") and singular(word) != word else word + "es"
    if word.endswith("y") and word[-2:-1] not in "aeiou":
        return word[:-1] + "ies"
    return word + "s"


def singular(word: str) -> str:
    """ "planks" → "plank", "leaves" → "leaf"; words that only look like plurals stay ("glass",
    "cactus").
    """
    if word in _SINGULAR:
        return _SINGULAR[word]
    if word.endswith("men") and len(word) > 4 and word not in _NO_MEN:
        return word[:-2] + "an"
    if (
        word in _SAME
        or not word.endswith("s")
        or word.endswith(("ss", "us", "is", "ness"))
        or len(word) < 4
    ):
        return word
    if word.endswith("ies"):
        return word[:-3] + "y"
    if word.endswith(("ches", "shes", "xes", "sses")):
        return word[:-2]
    return word[:-1]


def numbers(phrase: str) -> set[str]:
    """Singular and plural of a folded phrase: of its last word, or of the word before "of"."""
    words = phrase.split(" ")
    head = words.index("of") - 1 if "of" in words[1:] else len(words) - 1
    return {
        " ".join([*words[:head], made, *words[head + 1 :]])
        for made in (words[head], plural(words[head]), singular(words[head]))
    }


def joined(phrase: str) -> set[str]:
    """Two words written as one: "iron golem" → "irongolem"."""
    words = phrase.split(" ")
    return {"".join(words)} if len(words) == 2 and all(len(word) > 2 for word in words) else set()


def apart(word: str, known: Collection[str]) -> set[str]:
    """One word written as two that are both known: "cobblestone" → "cobble stone"."""
    if " " in word:
        return set()
    return {
        f"{word[:cut]} {word[cut:]}"
        for cut in range(3, len(word) - 2)
        if word[:cut] in known and word[cut:] in known
    }


def forms(phrase: str, known: Collection[str] = ()) -> set[str]:
    """All forms of a folded phrase, itself included."""
    variants = numbers(phrase)
    for variant in tuple(variants):
        variants |= joined(variant) | apart(variant, known)
    return variants
