"""`kb release publish`: the gate, then the upload of every folder.

To Zenodo one deposit a folder, a draft by default, new versions of old records
(kb.release.publish.upload); to the Hugging Face hub one repository with all of them
(kb.release.publish.repository). Both resume an interrupted upload.
"""

from typing import Any

from kb.artifacts import domain_binding
from kb.artifacts.release_folder import ReleaseFolder
from kb.core import signals
from kb.core.config.addresses import is_loopback
from kb.core.config.section import is_placeholder
from kb.core.context import Run
from kb.core.errors import KbError, ProfileError
from kb.core.summary import Summary
from kb.core.summary.plan import plan as make_plan
from kb.net.session import HttpSession, host_of
from kb.release.build import exported, refuse, refuse_unsigned
from kb.release.gate import GateProblem, check
from kb.release.metadata.measure import models
from kb.release.publish import repository, upload
from kb.release.publish.hub import PUBLIC, check_installed, check_name
from kb.release.publish.upload import Upload, document_of
from kb.release.publish.zenodo import TIMEOUT_S, Zenodo, stray
from kb.store.artifact_registry import SUMS
from kb.store.lock import RELEASES, writer
from kb.store.tables.reading import SANDBOX_MODEL

HOSTS = {"zenodo-sandbox": "https://sandbox.zenodo.org", "zenodo": "https://zenodo.org"}
HUB = "huggingface"
MOST_FILES, MOST_BYTES = 100, 50 * 10**9  # a record at Zenodo


def publish(
    run: Run, to: str, *, publish: bool = False, only: list[str] | None = None, **hub: Any
) -> Summary:
    """Deposit every folder of release/, or upload all to a repository of the hub.

    `hub`: what `repository.send` takes of a repository. Raises ProfileError, ReleaseRefused,
    MissingCredential, MissingExtra, SettingError, CredentialRefused, Stopped.
    """
    endpoint = _endpoint(run, to, hub.get("named"))
    token = run.settings.need("hf_token" if to == HUB else "zenodo_token")
    with domain_binding.writing(run, *RELEASES), writer(run.root, "deposits"):
        exports = exported(run, only or ())
        _check(run, exports, to, loopback=is_loopback(endpoint))
        if to == HUB:
            return repository.send(run, endpoint, token, exports, only=bool(only), **hub)
        return _deposit(run, endpoint, token, exports, publish=publish)


def plan(run: Run, to: str, *, only: list[str] | None = None, named: str | None = None) -> Summary:
    """What `publish` would send, after the same gate. Sends and writes nothing.

    Raises ProfileError, ReleaseRefused, MissingExtra, SettingError.
    """
    endpoint = _endpoint(run, to, named)
    exports = exported(run, only or ())
    _check(run, exports, to, loopback=is_loopback(endpoint))
    if to == HUB:
        return repository.planned(run, endpoint, exports, only=bool(only), named=named)
    phases = [upload.plan(run, endpoint, folder) for folder in exports]
    return Summary(make_plan("release publish", "", phases))


def _endpoint(run: Run, to: str, named: str | None) -> str:
    """The root of the service. Raises MissingExtra, SettingError for what it can't take."""
    if to != HUB:
        return run.settings.kb_zenodo_endpoint or HOSTS[to]
    check_installed()
    if named is not None:
        check_name(named)
    return run.settings.hf_endpoint or PUBLIC


def _deposit(
    run: Run, endpoint: str, token: str, exports: list[ReleaseFolder], *, publish: bool
) -> Summary:
    """One deposit a folder."""
    deposits: dict[str, Any] = {}
    # Uploads take their time; the token goes to one host only.
    session = HttpSession(run.settings, hosts={host_of(endpoint)}, stray=stray, timeout=TIMEOUT_S)
    service = Zenodo(session, endpoint, token, wait=run.wait)
    for folder in exports:
        try:
            signals.stop.raise_if_asked()
            deposits[folder.source] = Upload(run, service, folder).go(publish=publish)
        except KbError as error:
            public = [
                f"{source} ({deposit['doi'] or deposit['id']})"
                for source, deposit in deposits.items()
                if deposit["state"] == "published"
            ]
            before = f"; published before that: {', '.join(public)}" if public else ""
            error.args = (f"{folder.source}: {error}{before}",)
            error.summary = _summary(deposits)
            raise
    return _summary(deposits)


def _check(run: Run, exports: list[ReleaseFolder], to: str, *, loopback: bool) -> None:
    """Raises ProfileError and ReleaseRefused for what may not be published."""
    refuse_unsigned(run.profile, [folder.source for folder in exports])
    refuse(
        [
            *([] if loopback else _marked(run, exports)),
            *([] if to == HUB else _limits(exports)),
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


def _summary(deposits: dict[str, dict[str, Any]]) -> Summary:
    states = [deposit["state"] for deposit in deposits.values()]
    return Summary(
        command="release publish",
        deposits=len(deposits),
        drafts=states.count("draft"),
        published=states.count("published"),
        unchanged=states.count("unchanged"),
        uploaded=sum(deposit["uploaded"] for deposit in deposits.values()),
        sources={
            source: {name: what for name, what in deposit.items() if name != "uploaded"}
            for source, deposit in deposits.items()
        },
    )


def _marked(run: Run, exports: list[ReleaseFolder]) -> list[GateProblem]:
    """Scores of the sandbox's tiny model may go to a loopback service only."""
    problems = []
    for folder in exports:
        scored_by = {model for model, _, _ in models(run.root, folder.source)}
        if SANDBOX_MODEL in scored_by or document_of(folder).get("sandbox_model"):
            what = (
                "scored with the sandbox's tiny model, whose scores mean nothing about real texts;"
                " run `kb models fetch`, then `kb build`"
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
