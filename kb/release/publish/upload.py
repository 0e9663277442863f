"""Uploads one folder of a release to one deposit service.

The deposit is recorded before and after every step that can't be repeated. An interrupted run
resumes with the same draft and sends only files whose md5 differs; a draft that was published in
the meantime with these files is recorded, not published again.
"""

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kb.artifacts.release_folder import ReleaseFolder
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.summary.plan import PlanPhase
from kb.release.folders import DEPOSIT
from kb.release.metadata.zenodo import Document
from kb.release.publish.zenodo import SCOPES, Forbidden, Gone, Zenodo, doi, md5, page
from kb.store.artifact_registry import SUMS
from kb.store.atomic import write_text
from kb.store.layout import Layout
from kb.store.tables.checksums import digest


def document_of(folder: ReleaseFolder) -> dict[str, Any]:
    """What `kb release` wrote for the deposit; empty where it is not there or can't be read."""
    try:
        return dict(json.loads((folder.path / DEPOSIT).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def local_files(folder: ReleaseFolder) -> list[Path]:
    """Every file of a folder that is uploaded, the checksums last."""
    return [*folder.files(), folder.path / SUMS]


def plan(run: Run, address: str, folder: ReleaseFolder) -> PlanPhase:
    """What `Upload` would send, as far as that is known without asking the service."""
    known = Records(run.root).get(record_key(address, folder.source))
    done = known.get("published") == digest(folder.path / SUMS)
    local = [] if done else local_files(folder)
    size = sum(path.stat().st_size for path in local)
    # Beside the files: the draft, what it holds, its metadata, its publication.
    return PlanPhase(f"upload {folder.source}", len(local), len(local) + 4, gb=size / 1e9)


class Upload:
    """One folder on its way to one service."""

    def __init__(self, run: Run, service: Zenodo, folder: ReleaseFolder) -> None:
        self.run, self.service, self.folder = run, service, folder
        self.records = Records(run.root)
        self.key = record_key(service.root, folder.source)
        self.document = Document.model_validate(document_of(folder))
        self.metadata = self.document.metadata.model_dump(exclude_none=True, mode="json")
        self.digest = digest(folder.path / SUMS)

    def go(self, *, publish: bool) -> dict[str, Any]:
        """The deposit's state, id, address and uploaded files."""
        try:
            known = self._known()
            if known.get("published") == self.digest:
                return _shown("unchanged", known)
            draft = self._draft(known)
            if draft.get("submitted"):
                return self._published("unchanged", draft)
            uploaded = self._files(draft)
            described = self.service.describe(draft["id"], self.metadata)
            if not publish:
                record = {"id": draft["id"], "doi": doi(described), "page": page(described)}
                return _shown("draft", record, uploaded)
            signals.stop.raise_if_asked()
            public = self.service.publish(draft["id"])
            return self._published("published", public | {"id": draft["id"]}, uploaded)
        except Forbidden as error:
            error.hint = (
                "the deposit is another account's, or ZENODO_TOKEN may not do this: use a token of"
                f" the account that made it; {SCOPES}; then run the same command again"
            )
            raise

    def _published(self, state: str, shown: dict[str, Any], uploaded: int = 0) -> dict[str, Any]:
        """Record a publication, so that it is not repeated."""
        record = {"id": shown["id"], "doi": doi(shown), "page": page(shown)}
        self.records.write(self.key, {**record, "published": self.digest})
        return _shown(state, record, uploaded)

    def _known(self) -> dict[str, Any]:
        """What the state says of this folder, as far as the service still has it."""
        known = self.records.get(self.key)
        if "id" in known:
            try:
                self.service.get(known["id"])
            except Gone:
                self.run.progress.say(
                    f"deposit {known['id']} of {self.folder.source} is gone; creating a new one"
                )
                return {key: what for key, what in known.items() if key in ("draft", "creating")}
        return known

    def _draft(self, known: dict[str, Any]) -> Any:
        """The draft to fill: the one begun, the next version of the published record, or a new one.

        The record itself when the one begun was published meanwhile, by hand or by a run that was
        killed before it could note that, with the files of this folder.
        """
        if "draft" in known:
            try:
                deposit = self.service.get(known["draft"])
                if not deposit.get("submitted"):
                    return deposit
                if self._same(deposit):
                    return deposit
                known = {"id": deposit["id"], "published": "", "doi": doi(deposit)}
            except Gone:
                known.pop("draft")
        if "id" in known:
            self.records.write(self.key, known | {"creating": True})
            draft = self.service.new_version(known["id"])
        else:
            # A run that never got the answer left an empty draft with our title.
            drafts = self.service.drafts() if known.pop("creating", False) else ()
            lost = (draft for draft in drafts if draft.get("title") == self.metadata["title"])
            draft = next((record for record in lost if not record.get("files")), None)
            if draft is None:
                self.records.write(self.key, {"creating": True})
                draft = self.service.create(self.metadata)
        known.pop("creating", None)
        self.records.write(self.key, known | {"draft": draft["id"]})
        return draft

    def _same(self, record: dict[str, Any]) -> bool:
        """Whether a record holds exactly the folder's files."""
        there = {name: _md5_of(file) for name, file in self.service.files(record["id"]).items()}
        local = local_files(self.folder)
        return set(there) == {path.name for path in local} and all(
            there[path.name] == md5(path) for path in local
        )

    def _files(self, draft: dict[str, Any]) -> int:
        """Make the draft hold exactly the folder's files; how many were sent."""
        there = self.service.files(draft["id"])
        bucket = str(draft.get("links", {}).get("bucket", ""))
        local = local_files(self.folder)
        for name in sorted(set(there) - {path.name for path in local}):
            self.service.remove(draft["id"], there[name]["id"])
        sent, size = 0, sum(path.stat().st_size for path in local)
        with self.run.progress.task(f"upload {self.folder.source}", size, "bytes") as task:
            for path in local:
                signals.stop.raise_if_asked()
                checksum = md5(path)
                if path.name in there and _md5_of(there[path.name]) == checksum:
                    task.advance(path.stat().st_size)
                    continue
                self.service.upload(bucket, path, checksum, task.advance)
                sent += 1
        return sent


def _shown(state: str, record: dict[str, Any], uploaded: int = 0) -> dict[str, Any]:
    return {
        "state": state,
        "id": record["id"],
        "doi": record.get("doi"),
        "page": record.get("page"),
        "uploaded": uploaded,
    }


def _md5_of(file: dict[str, Any]) -> str:
    return str(file.get("checksum", "")).removeprefix("md5:")


def record_key(address: str, name: str) -> str:
    """The key of a folder or repository at a service. It begins with the host: the ports of a
    loopback service change with each start, hosts don't.
    """
    return f"{urlsplit(address).hostname}/{name}"


class Records:
    """`state/deposits.json`: what was uploaded where, by service and folder or repository.

    Ids and digests, no token.
    """

    def __init__(self, root: Path) -> None:
        self.path = Layout(root).deposits

    def all(self) -> dict[str, Any]:
        """Every entry. Raises DamagedData."""
        if not self.path.exists():
            return {}
        try:
            state = json.loads(self.path.read_text(encoding="utf-8"))
        except ValueError:
            state = None
        if not isinstance(state, dict) or not all(
            isinstance(entry, dict) and _is_entry(entry) for entry in state.values()
        ):
            raise DamagedData(
                f"{self.path} is damaged",
                hint="restore it from a copy: without it a folder that was published before would"
                " get a second record",
            )
        return state

    def get(self, key: str) -> dict[str, Any]:
        return dict(self.all().get(key, {}))

    def write(self, key: str, entry: dict[str, Any]) -> None:
        write_text(
            self.path, json.dumps(self.all() | {key: entry}, indent=1, sort_keys=True) + "\n"
        )


def _is_entry(entry: dict[str, Any]) -> bool:
    """Whether an entry of the state reads as one of ours: of a deposit or of a repository."""
    if "repository" in entry:
        return isinstance(entry["repository"], str) and isinstance(entry.get("files"), dict)
    return all(isinstance(entry[name], int) for name in ("id", "draft") if name in entry) and (
        "id" in entry or "published" not in entry
    )
