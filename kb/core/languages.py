"""One name for each language: services and files still use codes that ISO 639 has replaced."""

# As programs of speech recognition write them.
_CODES = {
    "arabic": "ar", "chinese": "zh", "czech": "cs", "danish": "da", "dutch": "nl", "english": "en",
    "finnish": "fi", "french": "fr", "german": "de", "greek": "el", "hindi": "hi",
    "hungarian": "hu", "indonesian": "id", "italian": "it", "japanese": "ja", "korean": "ko",
    "norwegian": "nb", "polish": "pl", "portuguese": "pt", "romanian": "ro", "russian": "ru",
    "spanish": "es", "swedish": "sv", "thai": "th", "turkish": "tr", "ukrainian": "uk",
    "vietnamese": "vi",
}  # fmt: skip
_NEWER = {"iw": "he", "in": "id", "ji": "yi", "no": "nb", "jw": "jv"}


def one_name(code: str) -> str:
    """The code with today's name of its language: `he` for `iw`, `he-IL` for `iw-IL`."""
    language, dash, region = code.partition("-")
    return f"{_NEWER.get(language, language)}{dash}{region}"


def code_of(name: str) -> str:
    """The code of a language that may be given by its English name; else the name as it is."""
    return _CODES.get(name.lower(), name)
