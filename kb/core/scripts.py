"""Scripts that put no spaces between words: there each sign counts as a word, for whoever counts,
looks for, or cuts words.
"""

import re
import unicodedata

# Thai, Lao, Myanmar, Khmer, Tai, kana, Han; in brackets of a pattern, in Python and in tantivy.
UNSPACED = (
    "\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u1950-\u19ff\u1a20-\u1aaf\u3005-\u3007\u3041-\u30ff"
    "\u31f0-\u31ff\u3400-\u4dbf\u4e00-\u9fff\ua9e0-\ua9ff\uaa60-\uaa7f\uf900-\ufaff\uff66-\uff9f"
    "\U0001b000-\U0001b16f\U00020000-\U0003ffff"
)
_SIGN = re.compile(f"[{UNSPACED}]")
_WORD = re.compile(rf"[{UNSPACED}]|[^\s{UNSPACED}]+")


def is_word(sign: str) -> bool:
    """Whether it is a letter, digit or mark of such a script."""
    return unicodedata.category(sign)[0] in "LNM" and _SIGN.match(sign) is not None


def words(text: str) -> list[str]:
    """The words between spaces, and each sign of such a script."""
    return text.split() if text.isascii() else _WORD.findall(text)


def closed(text: str) -> str:
    """The text without spaces beside such signs."""
    return text if text.isascii() else re.sub(rf"(?<=[{UNSPACED}]) | (?=[{UNSPACED}])", "", text)


def parts(text: str, most: int) -> list[tuple[str, int]]:
    """The text in parts of at most so many words, with their numbers of words; () without any."""
    if text.isascii():
        split = text.split()
        cut = (split[at : at + most] for at in range(0, len(split), most))
        return [(" ".join(some), len(some)) for some in cut]
    spans = [match.span() for match in _WORD.finditer(text)]
    cut_spans = (spans[at : at + most] for at in range(0, len(spans), most))
    return [(" ".join(text[some[0][0] : some[-1][1]].split()), len(some)) for some in cut_spans]
