"""Personal data beyond what the profile tolerates."""

from pathlib import Path

import pytest

from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused
from tests.release.made import build


@pytest.mark.parametrize(
    ("text", "what", "key", "rate"),
    [
        (
            "write to jane.doe+x@mail.example.org please",
            "an e-mail address",
            "emails_per_thousand",
            "0.2",
        ),
        ("call +1 (555) 010-9999 now", "a phone number", "phones_per_thousand", "0.5"),
        ("call 555-010-9999", "a phone number", "phones_per_thousand", "0.5"),
        ("mail jörg@exämple.de", "an e-mail address", "emails_per_thousand", "0.2"),
        ("appelez moi +33 6 12 34 56 78", "a phone number", "phones_per_thousand", "0.5"),
        ("ruf an 0171 1234567", "a phone number", "phones_per_thousand", "0.5"),
        ("WhatsApp me: 555 123 4567", "a phone number", "phones_per_thousand", "0.5"),
        ("+33612345678", "a phone number", "phones_per_thousand", "0.5"),
    ],
)
def test_personal_data_beyond_tolerance(
    tmp_path: Path, text: str, what: str, key: str, rate: str
) -> None:
    build(tmp_path, changed("wiki/cells", lambda row: row.update(text=text)), ("wiki",))
    assert refused(tmp_path) == [
        (
            f"personal data: wiki/cells: 1 of 36 rows have {what} in text,"
            f" [release] {key} tolerates {rate} per 1,000"
        )
    ]


@pytest.mark.parametrize(
    "text",
    [
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
    ],
)
def test_game_talk_is_no_personal_data(tmp_path: Path, text: str) -> None:
    build(
        tmp_path, changed("wiki/cells", lambda row: row.update(text=text), slice(None)), ("wiki",)
    )
    assert release(a_run(tmp_path))["folders"] == 1
