"""Uploads the folders of a release to one repository of the Hugging Face hub.

One repository with a folder each, not one each: `load_dataset("ORG/NAME", config)` finds every
table, and one tag names a version of all. A run makes at most one revision, so that readers see all
of it or nothing; large files that an interrupted run has sent are there for the next one. What a
folder no longer holds is removed from the newest revision; older ones keep it until `squash`.

`load_dataset` reads the card at the root only. So the metadata of the folders' cards are joined
there, with the folders' names before those of the files.
"""

import hashlib
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from kb.artifacts import release_folder
from kb.artifacts.release_folder import ReleaseFolder
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import FatalError, SettingError
from kb.core.sources import PUBLISHED
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPhase, plan
from kb.release.metadata.card import SIZES
from kb.release.publish.hub import MAIN, PACK, Hub, Revision, check_name
from kb.release.publish.upload import Records, document_of, local_files, record_key
from kb.store.artifact_registry import SUMS
from kb.store.tables.checksums import digest

CARD = "README.md"
_VERSION = re.compile(r"v\d+\.\d+\.\d+")
# What a repository may hold that somebody made on the site and that has no data yet.
_BARE = {".gitattributes", ".gitignore", "LICENSE", CARD}
_SHA256 = 64  # characters of a digest; git's have 40


def send(
    run: Run,
    endpoint: str,
    token: str,
    exports: Sequence[ReleaseFolder],
    *,
    only: bool,
    named: str | None,
    private: bool,
    squash: bool,
) -> Summary:
    """One revision of the repository that holds these folders, and the version's tag.

    `only`: other folders of the repository stay as they are. Raises CredentialRefused, FatalError,
    SettingError, Stopped.
    """
    service = Hub(endpoint, token)
    account = service.account()
    records = Records(run.root)
    repo = named or _known_name(records, endpoint) or f"{account}/{run.profile.name}"
    check_name(repo)
    key = record_key(endpoint, repo)
    known = records.get(key)
    newest = _opened(service, repo, private=private, known=bool(known))
    mine = _names(exports) if only else {*PUBLISHED, *_names(exports)}
    others = sorted(name for name in {*PUBLISHED} - mine if f"{name}/{SUMS}" in newest.files)
    digests = _digests(exports)
    files, removed = _changes(newest, exports, mine, digests)
    tag = f"v{_version(exports)}"
    cards = {folder.path.name: (folder.path / CARD).read_text("utf-8") for folder in exports}
    cards |= {name: service.text(repo, newest.id, f"{name}/{CARD}") for name in others}
    card = _card(run, repo, tag, cards)
    if newest.files.get(CARD) != _git_oid(card):
        files[CARD] = card
    head = newest.id
    if files or removed:
        head = _committed(run, service, repo, newest, files, removed, tag)
    older, tags = service.older(repo), service.tags(repo)
    if squash:
        signals.stop.raise_if_asked()
        head, tags = _squashed(service, repo, tag, head, tags, older=older)
        older = 0
    if tags.get(tag) != head:
        if tag in tags:
            service.untag(repo, tag)  # the same version, made again
        service.tag(repo, tag, head)
    left: dict[str, str] = known.get("files", {})
    kept = {path: what for path, what in left.items() if path.partition("/")[0] in others}
    records.write(key, {"repository": repo, "files": digests | kept, "revision": head, "tag": tag})
    more = {"older_revisions": older, "older_tags": ", ".join(sorted({*tags} - {tag}))}
    return Summary(_summary(service.root, repo, tag, head, exports, files, removed) | more)


def planned(
    run: Run,
    endpoint: str,
    exports: Sequence[ReleaseFolder],
    *,
    only: bool,
    named: str | None,
) -> Summary:
    """What `send` would do, by what was uploaded from this data root. Sends and writes nothing."""
    records = Records(run.root)
    known_as = named or _known_name(records, endpoint)
    repo = known_as or f"(the account of HF_TOKEN)/{run.profile.name}"
    there: dict[str, str] = records.get(record_key(endpoint, repo)).get("files", {})
    digests = _digests(exports)
    phases = []
    for folder in exports:
        inside = [path for path in digests if path.startswith(f"{folder.path.name}/")]
        new = [path for path in inside if there.get(path) != digests[path]]
        size = sum((folder.path / path.partition("/")[2]).stat().st_size for path in new)
        large = sum((folder.path / path.partition("/")[2]) in folder.data for path in new)
        requests = 2 * large + 2 * -(-len(new) // PACK)  # bytes and a check; modes and addresses
        phases.append(PlanPhase(f"upload {folder.source}", len(new), requests, gb=size / 1e9))
    mine = _names(exports) if only else {path.partition("/")[0] for path in there}
    removed = [path for path in there if path not in digests and path.partition("/")[0] in mine]
    if removed:
        phases.append(PlanPhase("remove", len(removed)))
    # Account, state, tree, card, revision, revisions, tags.
    phases.append(PlanPhase("revision and tag", 1, 9))
    assumed = [f"repository {repo}, tag v{_version(exports)}"]
    if there:
        assumed.append("the repository still holds what was uploaded from this data root")
    more = {"repository": known_as or "", "tag": f"v{_version(exports)}"}
    return Summary(plan("release publish", "", phases, assumed, **more))


def _opened(service: Hub, repo: str, *, private: bool, known: bool) -> Revision:
    """The repository's newest revision; the repository is made where there is none.

    Raises FatalError where it is somebody's for something else, or public and should be private.
    """
    newest = service.newest(repo)
    if newest is None:
        service.create(repo, private=private)
        newest = service.newest(repo)
        if newest is None:
            raise FatalError(
                f"the hub created {repo} but does not show it",
                hint="check that HF_TOKEN may read it, then run the same command again",
            )
        return newest
    is_release = any(f"{name}/{SUMS}" in newest.files for name in PUBLISHED)
    foreign = sorted(set(newest.files) - _BARE)
    if foreign and not (known or is_release):
        shown = ", ".join(foreign[:3]) + (" …" if len(foreign) > 3 else "")
        raise FatalError(
            f"the name {repo} is taken: it contains files that are not a release ({shown})",
            hint="choose another name with --repo; nothing was changed there",
        )
    if private and not newest.private:
        raise FatalError(
            f"{repo} is public already",
            hint="make it private in its settings on the hub, or leave out --private",
        )
    return newest


def _changes(
    newest: Revision,
    exports: Sequence[ReleaseFolder],
    mine: Collection[str],
    digests: Mapping[str, str],
) -> tuple[dict[str, Path | bytes], list[str]]:
    """The files that the hub has not yet as they are here, and those in folders of `mine` that are
    not here any more.
    """
    wanted = {
        f"{folder.path.name}/{path.name}": path
        for folder in exports
        for path in local_files(folder)
    }
    files: dict[str, Path | bytes] = {
        name: path
        for name, path in wanted.items()
        if not _same(newest.files.get(name), path, digests)
    }
    removed = [
        name
        for name in newest.files
        if "/" in name and name.partition("/")[0] in mine and name not in wanted
    ]
    return files, removed


def _committed(
    run: Run,
    service: Hub,
    repo: str,
    newest: Revision,
    files: Mapping[str, Path | bytes],
    removed: Sequence[str],
    tag: str,
) -> str:
    """Send a revision, with a bar of its bytes; its id."""
    signals.stop.raise_if_asked()
    size = sum(
        len(content) if isinstance(content, bytes) else content.stat().st_size
        for content in files.values()
    )
    with run.progress.task(f"upload {repo}", size, "bytes") as task:
        return service.commit(repo, newest.id, files, removed, f"Version {tag[1:]}", task.advance)


def _squashed(
    service: Hub, repo: str, tag: str, head: str, tags: Mapping[str, str], *, older: int
) -> tuple[str, dict[str, str]]:
    """Leave the newest revision alone, without the versions' tags, which would keep older ones,
    and without the large files of those; its id and the tags that are left.
    """
    stale = [
        name for name, at in tags.items() if _VERSION.fullmatch(name) and (older or at != head)
    ]
    for name in stale:
        service.untag(repo, name)
    if older:
        head = service.squash(repo, f"Version {tag[1:]}")
    newest = service.newest(repo)
    files = newest.files.values() if newest else ()
    service.drop_objects(repo, {digest for digest in files if len(digest) == _SHA256})
    return head, {name: at for name, at in tags.items() if name not in stale}


def _known_name(records: Records, endpoint: str) -> str | None:
    """The repository that this data root was uploaded to. Raises SettingError for several."""
    start = record_key(endpoint, "")
    names = [
        str(record["repository"])
        for key, record in records.all().items()
        if "repository" in record and key.startswith(start)
    ]
    if len(names) > 1:
        raise SettingError(
            f"this release was uploaded to {len(names)} repositories: {', '.join(sorted(names))}",
            hint="name one with --repo",
        )
    return names[0] if names else None


def _card(run: Run, repo: str, tag: str, cards: Mapping[str, str]) -> bytes:
    """The root's card; folders in the contract's order."""
    from huggingface_hub import DatasetCard

    order, ordered = [*PUBLISHED, *cards], {}
    for folder in sorted(cards, key=order.index):
        data: Any = DatasetCard(cards[folder], ignore_metadata_errors=True).data
        ordered[folder] = dict(data.to_dict())
    title = f"{run.profile.title}: knowledge base"
    about = f"A knowledge base about {run.profile.title}, in {len(cards)} folders."
    if len(cards) == 1:
        about = about.replace("in 1 folders", "in one folder")
    return repository_card(repo, title, about, tag[1:], ordered).encode()


def _version(exports: Sequence[ReleaseFolder]) -> str:
    """The highest version of the folders."""
    versions = [str(document_of(folder)["metadata"]["version"]) for folder in exports]
    return max(versions, key=lambda version: [int(part) for part in version.split(".")])


def _digests(exports: Sequence[ReleaseFolder]) -> dict[str, str]:
    """File → SHA-256, from the checksums that the gate has compared."""
    digests: dict[str, str] = {}
    for folder in exports:
        sums, _ = release_folder.sums(folder.path)
        for path in local_files(folder):
            digests[f"{folder.path.name}/{path.name}"] = sums.get(path.name) or digest(path)
    return digests


def _same(there: str | None, path: Path, digests: Mapping[str, str]) -> bool:
    """Whether the hub has this file: by SHA-256 for large ones, by git's digest for others."""
    if there is None:
        return False
    if len(there) == _SHA256:
        return there == digests[f"{path.parent.name}/{path.name}"]
    return there == _git_oid(path.read_bytes())


def _git_oid(data: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(data) + data, usedforsecurity=False).hexdigest()


def _names(exports: Sequence[ReleaseFolder]) -> set[str]:
    return {folder.path.name for folder in exports}


def _summary(
    root: str,
    repo: str,
    tag: str,
    revision: str,
    exports: Sequence[ReleaseFolder],
    files: Mapping[str, Any],
    removed: Sequence[str],
) -> Summary:
    touched = {path.partition("/")[0] for path in (*files, *removed)}
    states = {
        folder.source: "published" if folder.path.name in touched else "unchanged"
        for folder in exports
    }
    sources = {
        folder.source: {
            "state": states[folder.source],
            "page": f"{root}/datasets/{repo}/tree/{MAIN}/{folder.path.name}",
        }
        for folder in exports
    }
    return Summary(
        command="release publish",
        repository=repo,
        revision=revision,
        tag=tag,
        folders=len(exports),
        published=list(states.values()).count("published"),
        unchanged=list(states.values()).count("unchanged"),
        uploaded=len(files),
        removed=len(removed),
        sources=sources,
    )


def joined(title: str, cards: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The metadata of a repository, of its folders' in their order: lists without repeats, every
    config with its folder, and one default.
    """
    configs, infos = [], []
    for folder, card in cards.items():
        mine = [_in_folder(folder, config) for config in card.get("configs", [])]
        infos += _infos(card.get("dataset_info"), mine)
        configs += mine
    for config in configs:
        config.pop("default", None)
    if configs:
        configs[0]["default"] = True
    lists = {
        name: list(
            dict.fromkeys(value for card in cards.values() for value in _list(card.get(name)))
        )
        for name in ("license", "language", "size_categories", "task_categories", "tags")
    }
    sizes = [size for size in SIZES if size in lists["size_categories"]]
    lists["size_categories"] = sizes[-1:] or lists["size_categories"]
    metadata = {
        "license": lists.pop("license"),
        "pretty_name": title,
        **lists,
        "configs": configs,
        "dataset_info": infos,
    }
    return {name: what for name, what in metadata.items() if what}


def repository_card(
    repo: str, title: str, about: str, version: str, cards: Mapping[str, Mapping[str, Any]]
) -> str:
    """The text of README.md."""
    from huggingface_hub import DatasetCardData

    metadata = joined(title, cards)
    names = [config["config_name"] for config in metadata.get("configs", [])]
    rows = "\n".join(
        f"| [{folder}]({folder}/README.md) | {card.get('pretty_name', folder)}"
        f" | {', '.join(config['config_name'] for config in card.get('configs', []))}"
        f" | {', '.join(_list(card.get('license')))} |"
        for folder, card in cards.items()
    )
    first = names[0] if names else ""
    return f"""---
{DatasetCardData(**metadata).to_yaml().rstrip()}
---

# {title}

{about} Version {version}.

Each folder is a release of its own, with its own licence, card, datasheet, metadata and checksums.

| folder | what it holds | tables | licence |
| --- | --- | --- | --- |
{rows}

```python
from datasets import load_dataset

rows = load_dataset("{repo}", "{first}", split="train")  # any table above; streaming=True works too
```

```sh
hf download {repo} --repo-type dataset --local-dir release
kb verify release     # whether every file is as it was published
kb restore release    # the content, with your own keys or dumps
```

Rows that were removed since an earlier version are listed in each folder's `tombstones.ndjson`;
remove them from your copies, too.
"""


def _in_folder(folder: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """A config whose files lie in a folder."""
    files = [
        {**files_of, "path": [f"{folder}/{path}" for path in _list(files_of["path"])]}
        if isinstance(files_of.get("path"), list)
        else {**files_of, "path": f"{folder}/{files_of['path']}"}
        for files_of in config.get("data_files", [])
    ]
    return {**config, "data_files": files}


def _infos(infos: Any, configs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What a card says of its tables, each with the config's name: a card with one may leave it
    out.
    """
    names = [str(config["config_name"]) for config in configs]
    listed = [infos] if isinstance(infos, Mapping) else infos or []
    return [
        {"config_name": names[0], **entry} if len(names) == 1 else dict(entry) for entry in listed
    ]


def _list(value: Any) -> list[Any]:
    if value is None:
        return []
    return list(value) if isinstance(value, list | tuple) else [value]
