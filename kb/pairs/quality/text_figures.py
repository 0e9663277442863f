"""Figures of one pair's text: its language, a verb near the keyword, keywords, words a second."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import pyarrow as pa

from kb.core.installation import np
from kb.pairs.quality.hashed_words import HashedWords, hash_of, is_among

if TYPE_CHECKING:
    from lingua import LanguageDetector

NEAR = 5  # words before and after the keyword in which a verb is looked for
_ENOUGH = 0.1  # share of function words that decides the language
_FOLDER = Path(__file__).with_name("data")
# What is spoken most in videos; each language more costs time and memory for every text.
_LANGUAGES = (
    *("arabic", "chinese", "dutch", "english", "french", "german", "hindi", "indonesian"),
    *("italian", "japanese", "korean", "polish", "portuguese", "russian", "spanish", "swedish"),
    *("turkish", "vietnamese"),
)


class WordList(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """data/<language>.toml: words parted by spaces."""

    function_words: str
    verbs: str


class KnownWords(NamedTuple):
    """Sorted hashes of a language's words (uint64)."""

    function_words: np.ndarray
    verbs: np.ndarray


@cache
def known_words(language: str) -> KnownWords | None:
    """The words of a language; None where there is no list."""
    path = _FOLDER / f"{language}.toml"
    if not path.is_file():
        return None
    given = msgspec.toml.decode(path.read_bytes(), type=WordList)
    return KnownWords(_hashes(given.function_words), _hashes(given.verbs))


def _hashes(words: str) -> np.ndarray:
    return np.array(sorted(map(hash_of, words.split())), np.uint64)


def counted(words: HashedWords, known: np.ndarray) -> np.ndarray:
    """How many of the known words come before each word, and before the end (int64)."""
    return np.concatenate(([0], np.cumsum(is_among(words.hash, known))))


def has_verb(
    words: HashedWords,
    known: KnownWords,
    text: tuple[np.ndarray, np.ndarray],
    match: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Whether a verb stands in the text, at most five words from the keyword and not in it.

    `text`, `match`: the first word of each text and phrase, and the one after its last.
    """
    before = counted(words, known.verbs)
    low = np.maximum(text[0], match[0] - NEAR)
    high = np.minimum(text[1], match[1] + NEAR)
    around = before[np.maximum(high, low)] - before[low]
    return around > before[match[1]] - before[match[0]]


def languages(
    texts: pa.Array[Any], sure: np.ndarray, language: str
) -> tuple[pa.Array[Any], pa.Array[Any]]:
    """ISO 639-1 code of each text, and the model's confidence (0 to 1).

    `sure`: texts whose function words say that they are in `language`; their confidence is null, as
    is the language of a text without words of any language.
    """
    codes: list[str | None] = [language] * len(texts)
    confidence: list[float | None] = [None] * len(texts)
    for row in np.flatnonzero(~sure).tolist():
        codes[row], confidence[row] = detected(texts[row].as_py() or "")
    return pa.array(codes, pa.string()), pa.array(confidence, pa.float64())


def detected(text: str) -> tuple[str | None, float | None]:
    """A text's language by the model, and its confidence, rounded so that processors agree."""
    best = _detector().compute_language_confidence_values(text)[0]
    if not best.value:
        return None, None
    code: str = best.language.iso_code_639_1.name.lower()
    return code, round(best.value, 2)


@cache
def _detector() -> LanguageDetector:
    from lingua import Language, LanguageDetectorBuilder  # noqa: PLC0415  an extra's, and large

    known = [getattr(Language, name.upper()) for name in _LANGUAGES]
    return LanguageDetectorBuilder.from_languages(*known).with_low_accuracy_mode().build()


def sure(
    words: HashedWords, known: KnownWords | None, text: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Which texts are in the language of the known words by its function words."""
    if known is None:
        return np.zeros(len(text[0]), bool)
    before = counted(words, known.function_words)
    return (before[text[1]] - before[text[0]]) >= np.maximum(3, _ENOUGH * (text[1] - text[0]))
