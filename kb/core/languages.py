"""One name for each language: services and files still use codes that ISO 639 has replaced."""

_NEWER = {"iw": "he", "in": "id", "ji": "yi", "no": "nb", "jw": "jv"}


def one_name(code: str) -> str:
    """The code with today's name of its language: `he` for `iw`, `he-IL` for `iw-IL`."""
    language, dash, region = code.partition("-")
    return f"{_NEWER.get(language, language)}{dash}{region}"
