"""One folder of a release on its way to one deposit service.

What was done is kept in `state/deposits.json` (ids and digests, no token), written before and after
every step that can't be repeated: a run that was cut off goes on with the same draft and sends only
files whose md5 differs; a draft that was published meanwhile with these files is noted, not
repeated.
"""

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kb.artifacts.release_folder import ReleaseFolder
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.release.folders import DEPOSIT
from kb.release.metadata.zenodo import Document
from kb.release.publish.service import Forbidden, Gone, doi, page
from kb.release.publish.zenodo import Zenodo, md5
from kb.store.atomic import write_text
from kb.store.layout import Layout
from kb.store.tables.checksums import SUMS, digest


def document_of(folder: ReleaseFolder) -> dict[str, Any]:
    """What `kb release` wrote for the deposit; empty where it is not there or can't be read."""
    try:
        return dict(json.loads((folder.path / DEPOSIT).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


class Upload:
    """One folder on its way to one service."""

    def __init__(self, run: Run, service: Zenodo, folder: ReleaseFolder) -> None:
        self.run, self.service, self.folder = run, service, folder
        self.path = Layout(run.root).deposits
        host = urlsplit(service.root)
        # Ports change with each start of a loopback service; hosts don't.
        self.key = f"{host.hostname}/{folder.source}"
        self.document = Document.model_validate(document_of(folder))
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
            "doi": doi(shown),
            "page": page(shown),
            "uploaded": uploaded,
        }

    def _published(self, shown: dict[str, Any], state: str, uploaded: int) -> dict[str, Any]:
        """Note a record, so that it is not made again."""
        record = {"id": shown["id"], "doi": doi(shown), "page": page(shown)}
        self._write({**record, "published": self.digest})
        return {"state": state, **record, "uploaded": uploaded}

    def _known(self) -> dict[str, Any]:
        """What the state says of this folder, as far as the service still has it."""
        known = self._read()
        if "id" in known:
            try:
                self.service.get(known["id"])
            except Gone:
                self.run.progress.say(
                    f"deposit {known['id']} of {self.folder.source} is gone; creating a new one"
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
                deposit = self.service.get(known["draft"])
                if not deposit.get("submitted"):
                    return deposit
                if self._same(deposit):
                    return deposit
                known = {"id": deposit["id"], "published": "", "doi": doi(deposit)}
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
            state = json.loads(self.path.read_text(encoding="utf-8"))
        except ValueError:
            state = None
        if not isinstance(state, dict) or not all(
            isinstance(one, dict) and _is_entry(one) for one in state.values()
        ):
            raise DamagedData(
                f"{self.path} is damaged",
                hint="restore it, or move it away: then new drafts are made,"
                " also of what was published before",
            )
        return state

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
