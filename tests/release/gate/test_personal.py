"""Personal data beyond what the profile tolerates."""

import itertools
from pathlib import Path

from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused
from tests.release.made import build

EMAILS = ("write to jane.doe+x@mail.example.org please", "mail jörg@exämple.de")
PHONES = (
    "call +1 (555) 010-9999 now",
    "call 555-010-9999",
    "appelez moi +33 6 12 34 56 78",
    "ruf an 0171 1234567",
    "WhatsApp me: 555 123 4567",
    "+33612345678",
)
GAME_TALK = (
    "version 1.20.4",
    "at 1200 64 -300",
    "2026-11-01",
    "seed 4-8-15-16-23-42",
    "3.14159265",
    "meet @ the castle",
    "user@home",
    "100 200 3000",
    "at 255 64 1984",
    "+12 500 000 XP",
    "+3.14159265",
    "call it 1200 64 -300",
    "mobile version of 20.11.2026",
    "2026-11-01 12:00:00 +0100",
    "0101 0101 0101",
)


def told(root: Path, texts: tuple[str, ...]) -> None:
    """The wiki's 36 cells say these texts, and then game talk."""
    said = itertools.chain(texts, itertools.cycle(GAME_TALK))
    edit = changed("wiki/cells", lambda row: row.update(text=next(said)), slice(None))
    build(root, edit, ("wiki",))


def test_personal_data_beyond_tolerance(tmp_path: Path) -> None:
    """Each of them counts, and nothing else."""
    told(tmp_path, EMAILS + PHONES)
    assert sorted(refused(tmp_path)) == [
        f"personal data: wiki/cells: {n} of 36 rows have {what} in text,"
        f" [release] {key} tolerates {rate} per 1,000"
        for n, what, key, rate in (
            (len(EMAILS), "an e-mail address", "emails_per_thousand", "0.2"),
            (len(PHONES), "a phone number", "phones_per_thousand", "0.5"),
        )
    ]


def test_game_talk_is_no_personal_data(tmp_path: Path) -> None:
    told(tmp_path, ())
    assert release(a_run(tmp_path))["folders"] == 1
