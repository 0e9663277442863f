"""What the hub's refusals come to: one clear line each, without the token."""

from pathlib import Path

import pytest

from kb.core.errors import SettingError
from kb.release.publish.hub import check_name
from tests.faults import Sandbox
from tests.release.publish.hub_sending import REPO, held, kb, publish, summary
from tests.services.hub.service import READER, STRANGER, TOKEN

PAIRS = ("--repo", REPO, "--only", "pairs")


@pytest.mark.parametrize(
    "name", ["minecraft", "a/b/c", "a/b--c", "a/.b", "a/b.git", "a b/c", f"a/{'x' * 97}", ""]
)
def test_a_malformed_name_is_refused_before_anything_is_sent(name: str) -> None:
    with pytest.raises(SettingError, match="is not a valid repository name"):
        check_name(name)


@pytest.mark.parametrize(
    ("env", "code", "line"),
    [
        ({"HF_TOKEN": "hf_unknown0000000"}, 1, "kb: the hub does not accept HF_TOKEN;"),
        ({"HF_TOKEN": READER}, 1, f"kb: HF_TOKEN may not write to {REPO}: You don't have"),
        ({"HF_TOKEN": STRANGER}, 1, f"kb: HF_TOKEN may not write to {REPO}: You don't have"),
        ({"HF_TOKEN": ""}, 2, "kb: HF_TOKEN is not set"),
        ({"HF_HUB_OFFLINE": "1"}, 2, "kb: HF_HUB_OFFLINE is set"),
        ({"HF_ENDPOINT": "http://127.0.0.1:9"}, 4, "kb: no connection to the hub at http://127"),
    ],
)
def test_who_may_not_is_told_so(
    root: Path, hub: Sandbox, env: dict[str, str], code: int, line: str
) -> None:
    done = publish(hub, root, *PAIRS, **env)
    assert (done.code, done.said[: len(line)]) == (code, line)
    assert len(done.said.splitlines()) == 1
    tokens = {TOKEN, env.get("HF_TOKEN") or TOKEN}
    assert not [token for token in tokens if token in done.err + done.out]
    assert "Traceback" not in done.err


def test_a_token_that_may_only_read_uploads_nothing_to_what_is_there(
    root: Path, hub: Sandbox
) -> None:
    summary(publish(hub, root, *PAIRS, "--json"))
    head = held(hub).head
    (root / "release" / "pairs" / "README.md").unlink()
    assert kb(hub, root, "release", "--only", "pairs").code == 0
    done = publish(hub, root, "--repo", REPO, HF_TOKEN=READER)
    assert done.code == 1
    assert done.said.startswith(f"kb: HF_TOKEN may not write to {REPO}: You don't have permission")
    assert held(hub).head == head


FAULTS: tuple[tuple[str, dict[str, object], int, str], ...] = (
    ("/whoami", {"status": 200, "body": "<html>"}, 1, "kb: the hub at http://127.0.0.1:"),
    ("/repos/create", {"status": 409}, 1, f"kb: the name {REPO} is taken"),
    ("/batch", {"status": 404}, 1, f"kb: the hub answered 404 for {REPO}"),
    ("/commit/", {"status": 503}, 4, "kb: the hub answers 503"),
    ("/commit/", {"status": 400, "body": {"error": f"no {TOKEN}"}}, 1, "kb: the hub refused (400)"),
    ("/commit/", {"status": 412, "body": {"error": "later"}}, 1, f"kb: {REPO} was changed"),
    (
        "/commit/",
        {"status": 429, "headers": {"Retry-After": "3600"}},
        3,
        "kb: the hub's limit is spent until 20",
    ),
    ("/commit/", {"status": 200, "body": {}}, 1, "kb: the hub at http://127.0.0.1:"),
)


def test_what_goes_wrong_is_one_line_and_the_same_command_resumes(root: Path, hub: Sandbox) -> None:
    for path, fields, code, line in FAULTS:
        hub.faults.add(path, **fields)
        done = publish(hub, root, *PAIRS)
        assert (done.code, done.said[: len(line)]) == (code, line)
        assert TOKEN not in done.err + done.out
        assert "Traceback" not in done.err
    again = publish(hub, root, *PAIRS)
    assert again.code == 0, again.err


def test_options_of_the_other_service_are_refused(root: Path, hub: Sandbox) -> None:
    done = publish(hub, root, "--publish")
    assert (done.code, done.said.partition(";")[0]) == (
        2,
        "kb: --publish has no effect with --to huggingface",
    )
    for words in (("--private",), ("--repo", REPO), ("--squash-history",)):
        done = kb(hub, root, "release", "publish", "--to", "zenodo", *words)
        assert done.code == 2
        assert done.said.startswith(f"kb: {words[0]} has no effect with --to zenodo")
    assert len(hub.ledger) == 0
