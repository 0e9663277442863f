"""The player's answer has the form of recorded ones."""

import json
import re
from pathlib import Path

from kb.sandbox.server import Sandbox
from kb.sandbox.youtube import player
from tests.sandbox.domains import of_case
from tests.sandbox.youtube.test_resources import form, lacking


def test_the_player_answer_has_the_recorded_form(recorded: Path, services: Sandbox) -> None:
    folder = recorded / "youtube" / "transcripts"
    world = services.world.youtube
    for file, case, parts in (
        (
            "youtube.innertube.json",
            "manual",
            {
                "streamingData": ("formats", "adaptiveFormats"),
                "videoDetails": None,
                "captions": None,
            },
        ),
        ("youtube_age_restricted.innertube.json", "age restricted", {"videoDetails": None}),
        (
            "youtube_transcripts_disabled2.innertube.json",
            "no captions",
            {"streamingData": ("formats",)},
        ),
    ):
        real = json.loads((folder / file).read_text(encoding="utf-8"))
        video = of_case(world, case)[0]
        made = player.player_answer(video, video.id)
        assert made["playabilityStatus"]["status"] == real["playabilityStatus"]["status"]
        assert made["playabilityStatus"].get("reason") == real["playabilityStatus"].get("reason")
        assert ("captions" in made) == ("captions" in real)
        for part, inner in parts.items():
            ours, theirs = made[part], real[part]
            wanted = {name: theirs[name] for name in inner} if inner else theirs
            missing = [
                line
                for line in lacking(form(wanted), form(ours), part)
                if not re.search(
                    r"url|Range|lastModified|contentLength|colorInfo|averageBitrate|audio|qualityOrdinal|thumbnail|defaultCaption|captionsInitial|defaultTranslation|latency|LowLatency",
                    line,
                )
            ]
            assert missing == []
