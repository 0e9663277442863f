"""What a folder was made with: profile, keyword list, settings, seed, software.

profile.toml       the profile as used; it names its list as it lies beside it
keywords.tsv       the keyword lists as used, in one file
provenance.json    the rest, and what changed since the release before
"""

import hashlib
import json
import re
from typing import Any

import msgspec

from kb import __version__
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import ProfileError
from kb.core.installation import PROFILE_FILE, lock_digest, software_address
from kb.core.sources import RELEASES, SOURCES
from kb.release.history import Changes

KEYWORDS, PROVENANCE = "keywords.tsv", "provenance.json"
_COLUMNS = "keyword\tkind\trule\tforms"


def rules(profile: Profile, source: str) -> list[tuple[str, str]]:
    """(key, value) of thresholds and search words of a source, as the profile has them."""
    spec = RELEASES[source]
    named = spec.section or source
    section = getattr(profile, named, None)
    values = [] if section is None else [(name, getattr(section, name)) for name in spec.rules]
    if source in SOURCES:
        threshold = profile.toxicity.threshold(source)
        values.append(("toxicity", "not dropped" if threshold is None else threshold))
    return [
        (f"{named}.{name}", _shown(value)) for name, value in values if value not in ((), [], "")
    ]


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def files(run: Run, source: str, changed: Changes) -> dict[str, str]:
    """Name → text of what is written into the folder."""
    made = {PROFILE_FILE: profile_text(run.profile)}
    listed = keyword_text(run.profile)
    if listed:
        made[KEYWORDS] = listed
    made[PROVENANCE] = provenance(run, source, changed)
    return made


def provenance(run: Run, source: str, changed: Changes) -> str:
    """provenance.json as text."""
    address = software_address()
    document = {
        "software": {
            "name": "lorecrawl",
            "version": __version__,
            "lock_sha256": lock_digest(),
            **({"url": address} if address else {}),
        },
        "profile": {
            "name": run.profile.name,
            "seed": run.profile.seed,
            "sha256": hashlib.sha256(_file(run.profile).encode()).hexdigest(),
        },
        "version": run.profile.release.version,
        "settings": dict(rules(run.profile, source)),
        "changes": msgspec.to_builtins(changed) if changed.version else None,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def profile_text(profile: Profile) -> str:
    """The profile's file, with its lists named as they lie beside it in the folder."""
    text = _file(profile)
    lists = profile.pairs.keyword_files if profile.pairs else ()
    if lists in ((), (KEYWORDS,)):
        return text
    pattern = r"(?ms)^((?:pairs\.)?keyword_files\s*=\s*)\[.*?\]"
    return re.sub(pattern, rf'\g<1>["{KEYWORDS}"]', text, count=1)


def keyword_text(profile: Profile) -> str:
    """The keyword lists as one table: no comments, and every row with every column; "" without
    lists.
    """
    names = profile.pairs.keyword_files if profile.pairs else ()
    columns = _COLUMNS.split("\t")
    rows = []
    for name in names:
        for line in _read(profile, name).splitlines():
            cells = [cell.strip() for cell in line.split("\t")]
            if line.strip() and not line.startswith("#") and cells != columns:
                rows.append(cells + [""] * (len(columns) - len(cells)))
    lines = ["\t".join(cells) for cells in (columns, *rows)]
    return "\n".join(lines) + "\n" if names else ""


def _file(profile: Profile) -> str:
    try:
        return profile.path.read_text(encoding="utf-8")
    except OSError as error:
        raise ProfileError(f"profile {profile.path} can't be read: {error.strerror}") from None


def _read(profile: Profile, name: str) -> str:
    try:
        text = profile.resolve_file(name).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ProfileError(f"the keyword list {name} can't be read: {error.strerror}") from None
    return text if text.endswith("\n") else text + "\n"
