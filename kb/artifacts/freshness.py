"""What is out of date, and why: the one answer for `kb build`, `kb status`, what `kb release`
refuses, and the warnings of commands that read.

The manifest of an artifact records digests of its inputs, the values of the profile, keyword files
and recipes that made it, and the number of its rules. It is current when all three are those of now
and its inputs are current too.

    settings(run, "pairs")        what its manifest records
    reasons(run, "pairs")         why it has to be made again; [] where it has not
    plan(run, graph(run))         every artifact that is out of date with its reasons, in order
"""

import hashlib
import os
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts import index, manifest
from kb.artifacts.manifest import Manifest
from kb.artifacts.table_catalog import Catalog
from kb.artifacts.texts import exported_files
from kb.core.cached_property import cached_property
from kb.core.config.pipeline import digests
from kb.core.config.section import read_text
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, SettingError
from kb.core.installation import PROFILE_FILE, lock_digest
from kb.core.sources import MADE, PUBLISHED, SOURCES, made_of, selection_of
from kb.schema.tables import table
from kb.store.artifact_registry import ARTIFACTS, CHUNKS, RELEASE, selections
from kb.store.checkpoint import installed
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.version import __version__

MODEL = "KB_TOXICITY_MODEL"
FORMATS = tuple(dict.fromkeys(name for one in PUBLISHED.values() for name in one.formats))
NAMES = (
    *SOURCES,
    *(name for name, one in MADE.items() if not (one.part_of or one.selected_from)),
    *("index", "report", RELEASE),
)
NEVER_MADE = "not made yet"
REMOVED = "removed by a purge"
PURGED = "purged"  # in place of an input's digest: a purge took rows out of both
_NO_RECIPE = "its recipe was not recorded"
_LONGEST = 40  # characters of a value in a message
_SHOWN = 3  # artifacts that a warning names

Reasons = dict[str, list[str]]
"""Of artifacts, in the order in which they are made."""


class Now:
    """What the artifacts of a run are made of as it is now: read once for all of them."""

    def __init__(self, run: Run) -> None:
        self._profile = run.profile
        self.catalog = Catalog(run.root.absolute())
        self.texts = cache(self.catalog.texts)
        self.exported = cache(partial(exported_files, self.catalog))

    def values(self, parts: Sequence[str], others: Sequence[str] = ()) -> dict[str, Any]:
        """The values of these parts of the profile but for the others, and its keywords."""
        values = {
            key: value
            for key, value in self._values.items()
            if _is_in(key, parts) and not _is_in(key, others) and not key.endswith(".pipeline")
        }
        return values | (self._keywords if "keywords" in parts or "" in parts else {})

    @cached_property
    def _values(self) -> dict[str, Any]:
        data = self._profile.model_dump(mode="json")
        for name in SOURCES:
            if words := getattr(getattr(self._profile, name), "words", ()):
                data[name]["topic_keywords"] = list(words)
        return dict(_flat(data, ""))

    @cached_property
    def _keywords(self) -> dict[str, str]:
        files = self._profile.pairs.keyword_files if self._profile.pairs else ()
        return {file: _lines(self._profile.resolve_file(file)) for file in files}


def settings(run: Run, name: str, now: Now | None = None) -> dict[str, Any]:
    """The values that decide an artifact's content, by their keys in the profile; of a keyword
    file, digests of its lines; of its recipe and of the columns of its tables, a digest.
    """
    artifact = ARTIFACTS[name]
    values = (now or Now(run)).values(artifact.settings, artifact.other_settings)
    for made in artifact.tables:  # a table that has other columns now is made again
        values[f"schemas/{made}"] = _columns(made)
    if artifact.maker is not None:
        values |= digests(run.profile, artifact.maker.recipe)
    return values


@cache
def _columns(name: str) -> str:
    return hashlib.sha256(str(table(name).arrow()).encode()).hexdigest()[:12]


def _settings_now(run: Run, name: str, made: Manifest, now: Now) -> dict[str, Any]:
    """The same with the model whose scores count now: of another model that is not installed the
    stored scores are used as they are.
    """
    values, source = settings(run, name, now), name.removeprefix("clean/")
    if source != name and run.profile.toxicity.on and MODEL in made.settings:
        used = str(made.settings[MODEL])
        same = used.startswith(f"{run.settings.kb_toxicity_model}@")
        values[MODEL] = used if same else installed(run.settings) or used
    return values


def _flat(data: Mapping[str, Any], above: str) -> Iterable[tuple[str, Any]]:
    for name, value in data.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _is_in(key: str, parts: Sequence[str]) -> bool:
    return any(part in ("", key) or key.startswith(f"{part}.") for part in parts)


def _lines(path: Path) -> str:
    """A short digest of each line that is no comment."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError):
        return ""  # whoever reads the keywords says what is wrong
    rows = (line.strip() for line in text.splitlines())
    kept = (line for line in rows if line and not line.startswith("#"))
    return " ".join(hashlib.sha256(line.encode()).hexdigest()[:12] for line in kept)


def reasons(run: Run, name: str, stale: Collection[str] = (), now: Now | None = None) -> list[str]:
    """Why an artifact has to be made again, [] where it is current. Of its inputs those in `stale`
    count as changed. `now` is what was read for others of the run. Raises DamagedData.
    """
    now = now or Now(run)
    if name == RELEASE:
        return _release_reasons(run, stale, now)
    artifact, root = ARTIFACTS[name], run.root
    source = name.removeprefix("index/")
    place = index.home(root, source) if source != name else now.catalog.workplace
    made = manifest.read_manifest(place, name)
    if name == "release/open-text" and not run.profile.release.open_text:
        return ["release.open_text true → false"] if made or artifact.folder(root).exists() else []
    if made is None:
        return [NEVER_MADE]
    if artifact.maker is not None and manifest.is_vacant(made):
        return [REMOVED]
    why = manifest.damaged(place, name)[:1]
    if not made.figures.get("complete", True):
        why.append("not finished")
    reads_texts = source != name or name == "links"
    find = now.texts if reads_texts else now.exported
    for above in artifact.inputs:
        known = made.inputs.get(above)
        if above in stale:
            why.append(above)
        elif known not in (PURGED, manifest.input_digest(root, name, above, find)):
            why.append("/".join(above.split("/")[:2]))
    changed = changes(made, _settings_now(run, name, made, now))
    recipe = _unrecorded(made) if artifact.maker is not None else []
    return [*dict.fromkeys(why), *recipe, *changed]


def changes(made: Manifest, now: Mapping[str, Any]) -> list[str]:
    """What has changed of settings and rules since an artifact was made, in words."""
    before, rules = made.settings, ARTIFACTS[made.artifact].rules
    has_recipe = not _unrecorded(made)
    changed = [
        _change(key, before.get(key), now.get(key))
        for key in dict.fromkeys((*now, *before))
        if now.get(key) != before.get(key) and (has_recipe or not key.endswith(".py"))
    ]
    if len(changed) > 1:  # what changed in it is named
        changed = [path for path in changed if path != PROFILE_FILE]
    return changed + ([f"rules {made.rules} → {rules}"] if made.rules != rules else [])


def _unrecorded(made: Manifest) -> list[str]:
    """A reason, where an older version made an artifact."""
    return [] if any(key.endswith(".py") for key in made.settings) else [_NO_RECIPE]


def _change(key: str, before: Any, now: Any) -> str:
    if key.endswith(".tsv"):
        old, new = (Counter(str(text or "").split()) for text in (before, now))
        lines = max((new - old).total(), (old - new).total())
        return f"{key}, {lines} {'line' if lines == 1 else 'lines'}" if lines else f"{key}, order"
    if key.endswith(".py"):
        what = "is its recipe now" if before is None else "changed" if now else "is not its recipe"
        return f"{key} {what}"
    if key == PROFILE_FILE or key.startswith("schemas/"):
        return key
    if isinstance(before, list) and isinstance(now, list):
        more = [f"+{value}" for value in now if value not in before]
        fewer = [f"−{value}" for value in before if value not in now]
        return f"{key} {_short(' '.join([*more, *fewer]) or 'in another order')}"
    return f"{key} {_shown(before)} → {_shown(now)}"


def _shown(value: Any) -> str:
    if value is None:
        return "unset"
    return str(value).lower() if isinstance(value, bool) else _short(str(value))


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


# -- what is described by `kb release` -------------------------------------------------------------


def note_described(run: Run, names: Iterable[str]) -> None:
    """Record what the descriptions of these release folders were made of. Raises DiskFull."""
    made, now = manifest.read_manifest(run.root, RELEASE), _release_settings(run, Now(run))
    kept = made.inputs if made is not None and made.settings == now else {}
    inputs = kept | {f"release/{name}": _described_input(run.root, name) for name in names}
    place = ARTIFACTS[RELEASE].manifest(run.root)
    manifest.write_manifest(place, Manifest(RELEASE, "kb release", "", inputs, now, 1))


def _release_reasons(run: Run, stale: Collection[str], now: Now) -> list[str]:
    made = manifest.read_manifest(run.root, RELEASE)
    if made is None:
        return [NEVER_MADE]
    names = (*PUBLISHED, *filter(selection_of, selections(run.root)))
    folders = {f"release/{name}": name for name in names}
    why = [
        folder
        for folder, name in folders.items()
        if folder in stale  # one that was never made too
        or (
            ARTIFACTS[folder].manifest(run.root).exists()
            and made.inputs.get(folder) != _described_input(run.root, name)
        )
    ]
    return [*why, *_unrecorded(made), *changes(made, _release_settings(run, now))]


def _release_settings(run: Run, now: Now) -> dict[str, Any]:
    texts_ = run.profile.path.read_bytes() if run.profile.path.is_file() else b""
    values = now.values(("",))
    made_with = {
        "lorecrawl": __version__,
        "lock file": (lock_digest() or "")[:12],
        "SOURCE_DATE_EPOCH": os.environ.get("SOURCE_DATE_EPOCH"),
    }
    profile = {PROFILE_FILE: hashlib.sha256(texts_).hexdigest()[:12]}
    return values | made_with | profile | digests(run.profile, RELEASE)


def _described_input(root: Path, name: str) -> str:
    """A digest of all that a release folder's card speaks of: its data, what they were made of, and
    what was removed.
    """
    folder = Layout(root).release(name)
    parts = [str((folder / "SHA256SUMS").is_file())]
    artifacts = [f"release/{name}", *(f"clean/{source}" for source in made_of(name)), "labels"]
    if name in ARTIFACTS:
        artifacts.append(name)
    for artifact in artifacts:
        if (made := manifest.read_manifest(root, artifact)) is not None:
            parts.append(f"{artifact} {manifest.digest_of_files(made)}")
    parts += [str(tombstones.version(root, source)) for source in made_of(name)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


# -- the graph -------------------------------------------------------------------------------------


def graph(run: Run, asked: Sequence[str] = ()) -> list[str]:
    """The artifacts that `kb build` with these names looks after, each after its inputs; without
    names all but export formats, of which it makes those again that a purge removed. A source
    without raw data is left out. Raises SettingError.
    """
    if unknown := [name for name in asked if name not in (*NAMES, *FORMATS)]:
        raise SettingError(
            f"there is nothing called {unknown[0]!r} to build",
            hint=f"names: {', '.join(NAMES)}; formats: {', '.join(FORMATS)}",
        )
    every = [name for name in _made_again() if _is_possible(run, name)]
    if not asked:
        removed = manifest.vacant(run.root)
        return [name for name in every if not name.startswith("export/") or name in removed]
    wanted: set[str] = set()
    for name in every:
        kind, _, rest = name.partition("/")
        owner = PUBLISHED[rest].part_of or rest if rest in PUBLISHED else rest
        if (
            kind in asked
            or (kind in ("clean", "release") and owner in asked)
            or (kind == "release" and RELEASE in asked)
            or (kind == "export" and rest.partition("/")[0] in asked)
        ):
            wanted.add(name)
    wanted = wanted.union(*map(lineage, wanted))
    return [name for name in every if name in wanted]


def _made_again() -> list[str]:
    """Every artifact that can be made again, inputs first."""
    return [name for name, artifact in ARTIFACTS.items() if artifact.maker is not None]


def _is_possible(run: Run, name: str) -> bool:
    """Whether the data root and the profile have what an artifact is made of."""
    root, profile, maker = run.root, run.profile, ARTIFACTS[name].maker
    kind, _, rest = name.partition("/")
    if kind == "clean":
        but = (*SOURCES[rest].unfiltered, *SOURCES[rest].rowless)
        return getattr(profile, rest) is not None and rawlog.any_answer(root, rest, but)
    if name == "release/open-text" and not profile.release.open_text:
        return ARTIFACTS[name].folder(root).exists()
    if name.endswith(CHUNKS) and not ARTIFACTS[name].manifest(root).exists():
        return False  # how large they are is said by an export alone
    if profile.pairs is None and maker is not None and maker.recipe in ("pairs", "links"):
        return False
    return any(_has_rows(run, source) for source in sources_of(name))


def lineage(name: str) -> set[str]:
    """An artifact and all artifacts that it is made of."""
    above = [source for source in ARTIFACTS[name].inputs if source in ARTIFACTS]
    return {name}.union(*map(lineage, above))


def sources_of(name: str) -> set[str]:
    """The sources that an artifact is made of."""
    clean = (table.partition("/") for table in lineage(name))
    return {source for kind, _, source in clean if kind == "clean"}


def _has_rows(run: Run, source: str) -> bool:
    """Whether a source has clean tables, or raw answers that give some."""
    tables = SOURCES[source].tables
    there = any(Layout(run.root).rows(f"{source}/{short}") for short in tables)
    return there or _is_possible(run, f"clean/{source}")


def plan(run: Run, names: Iterable[str]) -> Reasons:
    """Of these artifacts, which come after their inputs, those that are out of date, and why.
    Raises DamagedData.
    """
    stale: Reasons = {}
    now = Now(run)
    for name in names:
        if why := reasons(run, name, stale, now):
            stale[name] = why
    return stale


def stale(run: Run, *names: str) -> Reasons:
    """What is out of date of these artifacts and of all that they are made of, as far as it was
    made here; nothing in a download, and where nothing can be made again.
    """
    if Catalog(run.root.absolute()).is_download:
        return {}
    wanted = set().union(*map(lineage, names))
    every = [name for name in _made_again() if name in wanted and _is_possible(run, name)]
    every += [f"release/{one}" for one in selections(run.root) if f"release/{one}" in wanted]
    return plan(run, [name for name in every if manifest.read_manifest(run.root, name) is not None])


def note_purged(run: Run, name: str) -> None:
    """Before a purge takes rows out of a selection and makes what it was selected from again: it is
    no reason to select again. What is out of date stays so. Raises DamagedData, DiskFull.
    """
    made = manifest.read_manifest(run.root, name)
    if made is not None and not reasons(run, name):
        marked = msgspec.structs.replace(made, inputs=dict.fromkeys(made.inputs, PURGED))
        manifest.write_manifest(ARTIFACTS[name].manifest(run.root), marked)


def settle_purged(run: Run, name: str) -> None:
    """Record the inputs of a selection as they are after the purge. Raises DamagedData,
    DiskFull.
    """
    made = manifest.read_manifest(run.root, f"release/{name}")
    if made is not None and PURGED in made.inputs.values():
        settled = msgspec.structs.replace(made, inputs=manifest.inputs(run.root, made.artifact))
        manifest.write_manifest(ARTIFACTS[made.artifact].manifest(run.root), settled)


def steps(outdated: Reasons) -> list[dict[str, Any]]:
    """The same for scripts: `artifact` and `reasons`."""
    return [{"artifact": name, "reasons": why} for name, why in outdated.items()]


def lines(outdated: Reasons) -> list[str]:
    """A line an artifact: its name and its reasons."""
    return [f"{name}: {', '.join(why)}" for name, why in outdated.items()]


def refuse(run: Run, *names: str) -> None:
    """Raises FatalError while one of these artifacts is out of date; a download never is."""
    if any(manifest.read_manifest(run.root, name) is not None for name in names) and (
        outdated := stale(run, *names)
    ):
        first = next(iter(outdated))
        raise FatalError(
            f"{names[0]} is out of date: {lines(outdated)[0]}",
            hint=f"run `kb build {names[0]}`" + ("" if len(outdated) == 1 else f" (first {first})"),
        )


def warning(run: Run) -> str:
    """A line for commands that only read, "" where everything is current. A root that can't be
    looked through is no reason to fail.
    """
    if run.profile.path == Path():  # without a profile nothing can be compared
        return ""
    try:
        if Catalog(run.root.absolute()).is_download:
            return ""
        names = [name for name in graph(run) if name not in (RELEASE, "report")]
        names = [name for name in names if not name.startswith("index/")]  # a search makes them
        names += [f"release/{name}" for name in selections(run.root)]
        outdated = {name: why for name, why in plan(run, names).items() if why != [NEVER_MADE]}
    except (DamagedData, OSError):
        return ""
    if not outdated:
        return ""
    shown = "; ".join(lines(outdated)[:_SHOWN])
    more = f" and {len(outdated) - _SHOWN} more" if len(outdated) > _SHOWN else ""
    return f"out of date: {shown}{more}; run `kb build`"
