"""`kb release publish`: one deposit a folder, a draft by default, resumable, new versions of old
records.

What was done is kept in `state/deposits.json` (ids and digests, no token), written before and after
every step that can't be repeated: a run that was cut off goes on with the same draft and sends only
files whose md5 differs; a draft that was published meanwhile with these files is noted, not
repeated.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kb.core import signals
from kb.core.addresses import is_loopback
from kb.core.context import Run
from kb.core.errors import DamagedData, KbError, ProfileError
from kb.core.sources import exported_by, made_by, made_of
from kb.core.verdict import Summary
from kb.net.session import Session, host_of
from kb.release import check, provenance
from kb.release.build import exported, refuse
from kb.release.deposit import TIMEOUT_S, Forbidden, Gone, Zenodo, md5, stray
from kb.release.folders import DEPOSIT, Folder
from kb.release.measure import models
from kb.release.metadata import Document
from kb.release.problem import Problem
from kb.store.atomic import write_text
from kb.store.digests import SUMS, digest
from kb.store.layout import Layout
from kb.store.lock import RELEASES, taking, writer
from kb.store.reading import SANDBOX_MODEL

HOSTS = {"zenodo-sandbox": "https://sandbox.zenodo.org", "zenodo": "https://zenodo.org"}
MOST_FILES, MOST_BYTES = 100, 50 * 10**9  # a record at Zenodo


def publish(run: Run, to: str, *, publish: bool = False, only: list[str] | None = None) -> Summary:
    """Deposit every folder of release/.

    Raises ProfileError, ReleaseRefused, MissingCredential, CredentialRefused, Stopped.
    """
    token = run.settings.need("zenodo_token")
    endpoint = run.settings.kb_zenodo_endpoint or HOSTS[to]
    with taking(run.root, *RELEASES):
        return _publish(run, endpoint, token, publish, only)


def _publish(run: Run, endpoint: str, token: str, publish: bool, only: list[str] | None) -> Summary:
    found = exported(run, only or ())
    _signed(run, found)
    loopback = is_loopback(endpoint)
    refuse(
        [
            *_marked(run, found, loopback),
            *_limits(found),
            *check.check(run, found),
            *check.check_made(run, found),
        ]
    )
    deposits: dict[str, Any] = {}
    with writer(run.root, "deposits"):
        service = Zenodo(_session(run, endpoint), endpoint, token, wait=run.wait)
        for folder in found:
            try:
                signals.stop.check()
                deposits[folder.source] = _Upload(run, service, folder).go(publish=publish)
            except KbError as error:
                error.args = (_told(folder, error, deposits),)
                error.summary = _summary(deposits)
                raise
    return _summary(deposits)


def _signed(run: Run, found: list[Folder]) -> None:
    """Raises ProfileError where profile or folders don't say who made them and whom to write to."""
    lacking = provenance.lacking(run.profile)
    if lacking:
        raise ProfileError(
            f"the profile {run.profile.path} names no {' and no '.join(lacking).replace('a ', '')}",
            hint="add [[release.creators]] with a name, and release.contact, an address for removal"
            " requests; then run `kb release` again",
        )
    for folder in found:
        used = folder.path / provenance.PROFILE
        if used.is_file() and provenance.unsigned(used.read_text(encoding="utf-8")):
            raise ProfileError(
                f"{folder.path} was made before the profile named a creator and a contact",
                hint="run `kb release` again",
            )


def _session(run: Run, endpoint: str) -> Session:
    """Uploads take their time; the token goes to one host only."""
    return Session(run.settings, hosts={host_of(endpoint)}, stray=stray, timeout=TIMEOUT_S)


def _summary(deposits: dict[str, dict[str, Any]]) -> Summary:
    states = [one["state"] for one in deposits.values()]
    return Summary(
        command="release publish",
        deposits=len(deposits),
        drafts=states.count("draft"),
        published=states.count("published"),
        unchanged=states.count("unchanged"),
        uploaded=sum(one["uploaded"] for one in deposits.values()),
        sources={
            source: {name: what for name, what in one.items() if name != "uploaded"}
            for source, one in deposits.items()
        },
    )


def _told(folder: Folder, error: KbError, deposits: dict[str, dict[str, Any]]) -> str:
    """The error with the folder it is about, and with what is public already."""
    public = [
        f"{source} ({one['doi'] or one['id']})"
        for source, one in deposits.items()
        if one["state"] == "published"
    ]
    return f"{folder.source}: {error}" + (
        f"; published before that: {', '.join(public)}" if public else ""
    )


def _again(source: str) -> str:
    """The commands that make a folder of release/ again with other scores."""
    filters = [f"`{made_by(one)}`" for one in made_of(source)]
    return f"{', '.join(filters)} and `{exported_by(source)}`"


def _marked(run: Run, found: list[Folder], loopback: bool) -> list[Problem]:
    """Scores of the sandbox's tiny model may go to a loopback service only."""
    if loopback:
        return []
    return [
        Problem(
            "sandbox model",
            folder.source,
            (
                "scored with the sandbox's tiny model, whose scores mean nothing about real texts;"
                f" run `kb models fetch`, then {_again(folder.source)}"
            ),
        )
        for folder in found
        if any(model == SANDBOX_MODEL for model, _, _ in models(run.root, folder.source))
        or _document(folder).get("sandbox_model")
    ]


def _document(folder: Folder) -> dict[str, Any]:
    try:
        return dict(json.loads((folder.path / DEPOSIT).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def _limits(found: list[Folder]) -> list[Problem]:
    problems = []
    for folder in found:
        files = [*folder.files(), folder.path / SUMS]
        total = sum(path.stat().st_size for path in files if path.exists())
        if len(files) > MOST_FILES:
            problems.append(
                Problem(
                    "size",
                    folder.source,
                    f"{len(files)} files, a record takes {MOST_FILES}; export larger shards",
                )
            )
        if total > MOST_BYTES:
            problems.append(
                Problem(
                    "size",
                    folder.source,
                    f"{total / 1e9:.1f} GB, a record takes {MOST_BYTES / 1e9:.0f}",
                )
            )
    return problems


class _Upload:
    """One folder on its way to one service."""

    def __init__(self, run: Run, service: Zenodo, folder: Folder) -> None:
        self.run, self.service, self.folder = run, service, folder
        self.path = Layout(run.root).deposits
        host = urlsplit(service.root)
        # Ports change with each start of a loopback service; hosts don't.
        self.key = f"{host.hostname}/{folder.source}"
        self.document = Document.model_validate(_document(folder))
        self.metadata = self.document.metadata.model_dump(exclude_none=True, mode="json")
        self.digest = digest(folder.path / SUMS)

    def go(self, *, publish: bool) -> dict[str, Any]:
        """The deposit's state, id, address and uploaded files."""
        try:
            return self._go(publish=publish)
        except Forbidden as error:
            error.hint = (
                "the deposit is another account's, or ZENODO_TOKEN may not do this:"
                f" use the token that made it, or move {self.path} away"
            )
            raise

    def _go(self, *, publish: bool) -> dict[str, Any]:
        known = self._known()
        if known.get("published") == self.digest:
            return {
                "state": "unchanged",
                "id": known["id"],
                "doi": known.get("doi"),
                "page": known.get("page"),
                "uploaded": 0,
            }
        draft = self._draft(known)
        if draft.get("submitted"):
            return self._published(draft, "unchanged", 0)
        uploaded = self._files(draft)
        shown = self.service.describe(draft["id"], self.metadata)
        if publish:
            signals.stop.check()
            return self._published(
                {**self.service.publish(draft["id"]), "id": draft["id"]}, "published", uploaded
            )
        return {
            "state": "draft",
            "id": draft["id"],
            "doi": shown.get("doi"),
            "page": _page(shown),
            "uploaded": uploaded,
        }

    def _published(self, shown: dict[str, Any], state: str, uploaded: int) -> dict[str, Any]:
        """Note a record, so that it is not made again."""
        told = {"id": shown["id"], "doi": shown.get("doi"), "page": _page(shown)}
        self._write({**told, "published": self.digest})
        return {"state": state, **told, "uploaded": uploaded}

    def _known(self) -> dict[str, Any]:
        """What the state says of this folder, as far as the service still has it."""
        known = self._read()
        if "id" in known:
            try:
                self.service.get(known["id"])
            except Gone:
                self.run.progress.say(
                    f"the deposit {known['id']} of {self.folder.source} is gone; a new one is made"
                )
                return {key: what for key, what in known.items() if key in ("draft", "creating")}
        return known

    def _draft(self, known: dict[str, Any]) -> dict[str, Any]:
        """The draft to fill: the one begun, the next version of the published record, or a new one.

        The record itself when the one begun was published meanwhile, by hand or by a run that was
        killed before it could note that, with the files of this folder.
        """
        if "draft" in known:
            try:
                found = self.service.get(known["draft"])
                if not found.get("submitted"):
                    return found
                if self._same(found):
                    return found
                known = {"id": found["id"], "published": "", "doi": found.get("doi")}
            except Gone:
                known.pop("draft")
        if "id" in known:
            self._write(known | {"creating": True})
            draft = self.service.new_version(known["id"])
        elif lost := self._lost_draft(known):
            draft = lost
        else:
            self._write({"creating": True})
            draft = self.service.create(self.metadata)
        self._write(
            {key: what for key, what in known.items() if key != "creating"} | {"draft": draft["id"]}
        )
        return draft

    def _lost_draft(self, known: dict[str, Any]) -> dict[str, Any] | None:
        """A draft that an earlier run created without learning of it: ours by its title,
        still empty.
        """
        if not known.get("creating"):
            return None
        return next(
            (
                one
                for one in self.service.drafts()
                if one.get("title") == self.metadata["title"] and not one.get("files")
            ),
            None,
        )

    def _local(self) -> list[Path]:
        return [*self.folder.files(), self.folder.path / SUMS]

    def _same(self, record: dict[str, Any]) -> bool:
        """Whether a record holds exactly the folder's files."""
        there = {name: _md5_of(one) for name, one in self.service.files(record["id"]).items()}
        local = self._local()
        return set(there) == {path.name for path in local} and all(
            there[path.name] == md5(path) for path in local
        )

    def _files(self, draft: dict[str, Any]) -> int:
        """Make the draft hold exactly the folder's files; how many were sent."""
        there = self.service.files(draft["id"])
        bucket = str(draft.get("links", {}).get("bucket", ""))
        local = self._local()
        for name in sorted(set(there) - {path.name for path in local}):
            self.service.remove(draft["id"], there[name]["id"])
        sent, size = 0, sum(path.stat().st_size for path in local)
        with self.run.progress.task(f"upload {self.folder.source}", size, "bytes") as task:
            for path in local:
                signals.stop.check()
                checksum = md5(path)
                if path.name in there and _md5_of(there[path.name]) == checksum:
                    task.advance(path.stat().st_size)
                    continue
                self.service.upload(bucket, path, checksum, task.advance)
                sent += 1
        return sent

    def _all(self) -> dict[str, Any]:
        if not self.path.exists():
            return {}
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
        except ValueError:
            found = None
        if not isinstance(found, dict) or not all(
            isinstance(one, dict) and _is_entry(one) for one in found.values()
        ):
            raise DamagedData(
                f"{self.path} is damaged",
                hint="restore it, or move it away: then new drafts are made,"
                " also of what was published before",
            )
        return found

    def _read(self) -> dict[str, Any]:
        return dict(self._all().get(self.key, {}))

    def _write(self, entry: dict[str, Any]) -> None:
        write_text(
            self.path, json.dumps(self._all() | {self.key: entry}, indent=1, sort_keys=True) + "\n"
        )


def _is_entry(entry: dict[str, Any]) -> bool:
    """Whether an entry of the state reads as one of ours."""
    return all(isinstance(entry[name], int) for name in ("id", "draft") if name in entry) and (
        "id" in entry or "published" not in entry
    )


def _md5_of(file: dict[str, Any]) -> str:
    return str(file.get("checksum", "")).removeprefix("md5:")


def _page(shown: dict[str, Any]) -> str | None:
    """Where a person looks at the deposit."""
    page = shown.get("links", {}).get("html")
    return str(page) if page else None
