"""Languages are compared as languages: `eng`, `en-001` and `en_US` are English, `iw` is `he`, `ger`
and `deu` are `de`, `cmn` and `zh-Hant` are Chinese. The package langcodes knows their codes.
"""

import re
from functools import cache

from kb.core.installation import langcodes

_ENGLISH = "en"  # known without the package, which takes 0.06 s to import
_NONE = ("mis", "mul", "und", "zxx")  # ISO 639's codes of no, several or an unknown language


@cache
def tag(code: str) -> str:
    """The one tag (BCP 47) of a language with its script and region: `he-IL` of `iw_IL`, `de` of
    `ger`. What is no tag stays as it is.
    """
    if code == _ENGLISH or not langcodes.tag_is_valid(code):
        return code
    # langcodes keeps the older code of Bokmål.
    return re.sub(r"^no\b", "nb", langcodes.standardize_tag(code, macro=True))


@cache
def primary_language(code: str) -> str:
    """The language alone, by its shortest code: `es` of `es-419`, `en` of `eng`."""
    return re.split("[-_]", tag(code))[0].lower()


def is_same_language(code: str, other: str) -> bool:
    """Whether two codes name one language, whatever their scripts and regions."""
    return primary_language(code) == primary_language(other)


def is_language(code: str) -> bool:
    """Whether a code names one language that is known."""
    is_valid = code == _ENGLISH or langcodes.tag_is_valid(code)
    return is_valid and primary_language(code) not in _NONE


def three_letters(code: str) -> str | None:
    """ISO 639-2's terminological code of a language, `deu` of `de`; None for what has none."""
    try:
        return langcodes.Language.get(primary_language(code)).to_alpha3()
    except (LookupError, ValueError):
        return None


def code_of(name: str) -> str:
    """The tag of a language that may be given by its English name; else the name as it is."""
    return tag(name if is_language(name) else _by_name().get(name.lower(), name))


@cache
def _by_name() -> dict[str, str]:
    """English names in IANA's registry with their codes, such as "greek" of "Modern Greek (1453-)".
    The first of a name counts: those of two letters come first.
    """
    names: dict[str, str] = {}
    for entry in langcodes.registry_parser.parse_registry():  # type: ignore[no-untyped-call]
        if entry["Type"] == "language":
            for name in entry["Description"]:
                plain = re.sub(r"\s*\(.*\)", "", name).removeprefix("Modern ").lower()
                names.setdefault(plain, entry["Subtag"])
    return names
