"""`kb release publish`: one deposit a folder, a draft by default, new versions of old records.

Each folder is sent by kb.release.publish.upload, which resumes an interrupted upload.
"""

import tomllib
from typing import Any

from kb.artifacts import domain_binding
from kb.artifacts.release_folder import ReleaseFolder
from kb.core import signals
from kb.core.config.addresses import is_loopback
from kb.core.config.profile.base import is_placeholder
from kb.core.config.profile.release import Release
from kb.core.context import Run
from kb.core.errors import KbError, ProfileError
from kb.core.installation import PROFILE_FILE
from kb.core.sources import exported_by, made_by, made_of
from kb.core.summary import Summary
from kb.net.session import HttpSession, host_of
from kb.release.build import exported, refuse
from kb.release.gate import GateProblem, check
from kb.release.metadata.measure import models
from kb.release.publish.service import TIMEOUT_S, stray
from kb.release.publish.upload import Upload, document_of
from kb.release.publish.zenodo import Zenodo
from kb.store.lock import RELEASES, writer
from kb.store.tables.checksums import SUMS
from kb.store.tables.reading import SANDBOX_MODEL

HOSTS = {"zenodo-sandbox": "https://sandbox.zenodo.org", "zenodo": "https://zenodo.org"}
MOST_FILES, MOST_BYTES = 100, 50 * 10**9  # a record at Zenodo


def publish(run: Run, to: str, *, publish: bool = False, only: list[str] | None = None) -> Summary:
    """Deposit every folder of release/.

    Raises ProfileError, ReleaseRefused, MissingCredential, CredentialRefused, Stopped.
    """
    token = run.settings.need("zenodo_token")
    endpoint = run.settings.kb_zenodo_endpoint or HOSTS[to]
    deposits: dict[str, Any] = {}
    with domain_binding.writing(run, *RELEASES), writer(run.root, "deposits"):
        exports = exported(run, only or ())
        _check(run, exports, loopback=is_loopback(endpoint))
        # Uploads take their time; the token goes to one host only.
        session = HttpSession(
            run.settings, hosts={host_of(endpoint)}, stray=stray, timeout=TIMEOUT_S
        )
        service = Zenodo(session, endpoint, token, wait=run.wait)
        for folder in exports:
            try:
                signals.stop.check()
                deposits[folder.source] = Upload(run, service, folder).go(publish=publish)
            except KbError as error:
                error.args = (_with_folder(folder, error, deposits),)
                error.summary = _summary(deposits)
                raise
    return _summary(deposits)


def _check(run: Run, exports: list[ReleaseFolder], *, loopback: bool) -> None:
    """Raises ProfileError and ReleaseRefused for what may not be published."""
    _signed(run, exports)
    refuse(
        [
            *([] if loopback else _marked(run, exports)),
            *_limits(exports),
            *check.check(run, exports),
            *check.check_made(run, exports),
        ]
    )
    contact = run.profile.release.contact
    if not loopback and contact and is_placeholder(contact):
        raise ProfileError(
            f"the contact of the profile {run.profile.path} is the placeholder {contact}",
            hint="set release.contact to an address that you read; then run `kb release` again",
        )


def _signed(run: Run, exports: list[ReleaseFolder]) -> None:
    """Raises ProfileError where profile or folders don't say who made them and whom to write to."""
    lacking = run.profile.release.unsigned()
    if lacking:
        raise ProfileError(
            f"the profile {run.profile.path} names no {' and no '.join(lacking).replace('a ', '')}",
            hint="add [[release.creators]] with a name, and release.contact, an address for removal"
            " requests; then run `kb release` again",
        )
    for folder in exports:
        used = folder.path / PROFILE_FILE
        section = tomllib.loads(used.read_text(encoding="utf-8")) if used.is_file() else {}
        if used.is_file() and Release.model_construct(**section.get("release", {})).unsigned():
            raise ProfileError(
                f"{folder.path} was made before the profile named a creator and a contact",
                hint="run `kb release` again",
            )


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


def _with_folder(folder: ReleaseFolder, error: KbError, deposits: dict[str, dict[str, Any]]) -> str:
    """The error with the folder it is about, and with what is public already."""
    public = [
        f"{source} ({one['doi'] or one['id']})"
        for source, one in deposits.items()
        if one["state"] == "published"
    ]
    return f"{folder.source}: {error}" + (
        f"; published before that: {', '.join(public)}" if public else ""
    )


def _marked(run: Run, exports: list[ReleaseFolder]) -> list[GateProblem]:
    """Scores of the sandbox's tiny model may go to a loopback service only."""
    problems = []
    for folder in exports:
        scored_by = {model for model, _, _ in models(run.root, folder.source)}
        if SANDBOX_MODEL in scored_by or document_of(folder).get("sandbox_model"):
            filters = ", ".join(f"`{made_by(one)}`" for one in made_of(folder.source))
            what = (
                "scored with the sandbox's tiny model, whose scores mean nothing about real texts;"
                f" run `kb models fetch`, then {filters} and `{exported_by(folder.source)}`"
            )
            problems.append(GateProblem("sandbox model", folder.source, what))
    return problems


def _limits(exports: list[ReleaseFolder]) -> list[GateProblem]:
    problems = []
    for folder in exports:
        files = [*folder.files(), folder.path / SUMS]
        total = sum(path.stat().st_size for path in files if path.exists())
        if len(files) > MOST_FILES:
            what = f"{len(files)} files, a record takes {MOST_FILES}; export larger shards"
            problems.append(GateProblem("size", folder.source, what))
        if total > MOST_BYTES:
            what = f"{total / 1e9:.1f} GB, a record takes {MOST_BYTES / 1e9:.0f}"
            problems.append(GateProblem("size", folder.source, what))
    return problems
