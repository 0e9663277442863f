"""Language and verbs of texts."""

import numpy as np
import pyarrow as pa
import pytest

from kb.pairs import quality
from kb.pairs.repeated_text import hashed_words
from kb.pairs.transcript_batch import Text
from tests.pairs.conftest import transcripts

TEXTS = {
    "en": "so now you take the bucket and just put it into your furnace with what you got there",
    "de": "jetzt nehmen wir den Eimer und stellen ihn in den Ofen, damit er schmelzen kann",
    "es": "ahora tomamos el cubo y lo ponemos en el horno para que se derrita muy bien",
    "fr": "maintenant nous prenons le seau et nous le mettons dans le four pour le fondre",
    "pt": "hoje a gente vai construir uma fazenda pequena do lado da casa e conseguir muito ferro",
    "it": "oggi costruiamo una piccola fattoria accanto alla casa per avere sempre tanto ferro",
    "nl": "nu bouwen we samen een kleine boerderij naast het huis en ik laat zien hoe dat moet",
    "pl": "dzisiaj zbudujemy małą farmę zaraz obok domu i pokażę wam jak łatwo zdobyć żelazo",
    "ru": "сегодня мы построим маленькую ферму рядом с домом и я покажу как получить железо",
}


@pytest.mark.parametrize("code", TEXTS)
def test_the_language_of_a_text(code: str) -> None:
    text = Text(transcripts(("v", "asr", [(0, 9, TEXTS[code])])))
    words, known = hashed_words(text), quality.known_words("en")
    whole = np.array([0]), np.array([len(words.hash)])
    sure = quality.sure(words, known, whole)
    assert sure.tolist() == [code == "en"]
    codes, confidence = quality.languages(pa.array([TEXTS[code]]), sure, "en")
    assert codes.to_pylist() == [code]
    assert (confidence[0].as_py() or 0) > 0.5 or code == "en"


def test_without_a_list_of_words_the_model_decides() -> None:
    text = Text(transcripts(("v", "asr", [(0, 9, TEXTS["en"])])))
    whole = np.array([0]), np.array([1])
    assert quality.known_words("xx") is None
    assert quality.sure(hashed_words(text), None, whole).tolist() == [False]
    assert quality.detected(TEXTS["en"])[0] == "en"
    assert quality.detected("12 34") == (None, None)


@pytest.mark.parametrize(
    ("said", "verb"),
    [
        ("dig down to the oak log", True),
        ("the oak log here and then we build", True),
        ("the oak log one two three four five build", False),
        ("build one two three four five oak log", False),
        ("a quiet oak log", False),
    ],
)
def test_a_verb_near_the_keyword(said: str, verb: bool) -> None:
    words = hashed_words(Text(transcripts(("v", "asr", [(0, 9, said)]))))
    known = quality.known_words("en")
    assert known is not None
    at = said.split().index("oak")
    bounds = (np.array([0]), np.array([len(words.hash)])), (np.array([at]), np.array([at + 2]))
    assert quality.has_verb(words, known, *bounds).tolist() == [verb]
