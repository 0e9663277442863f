"""A second domain is a second profile and no code: invented, small, through the whole chain.

The sandbox's videos that carry the label of another game are this domain's; the rest are not.
"""

import json
from pathlib import Path

from kb.sandbox.domain import OTHER_LABEL
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.world import World
from tests.cli.conftest import Kb, kb  # noqa: F401  (a fixture)
from tests.conftest import needs
from tests.faults import Sandbox

needs("torch")


PROFILE = f"""
name = "harborlight"
title = "Harborlight"
seed = 7

[youtube]
keywords = ["guide", "survival"]
topic_keywords = ["harborlight"]
game_ids = ["{OTHER_LABEL}"]
category_ids = [20]
min_views = 0
min_aspect_ratio = 0.1
min_duration_s = 1

[wiki]
url = "https://harbour.example"
min_words = 5

[pairs]
keyword_files = ["words.tsv"]
min_clip_s = 4
max_clip_s = 6

[reddit]
subreddit = "harborlight"
min_score = 2000

[release.licenses]
youtube = "CC-BY-4.0"
wiki = "CC0-1.0"
reddit = "CC-BY-4.0"
pairs = "CC-BY-4.0"
"""
WORDS = "keyword\tkind\trule\tforms\n" + "".join(
    f"{word}\tplace\t\t\n" for word in ("River", "Harbour", "Bridge", "Village", "Torch", "Wolf")
)


def test_the_whole_chain_from_a_file_of_its_own(tmp_path: Path, kb: Kb) -> None:  # noqa: F811
    (tmp_path / "words.tsv").write_text(WORDS)
    (tmp_path / "harborlight.toml").write_text(PROFILE)
    world = World(n_videos=200, n_pages=5)
    world.reddit = Subreddit(3, 40, width=30, depth=8, name="harborlight")
    with Sandbox(world) as services:
        env = services.settings(model=True)

        def run(*arguments: str) -> dict[str, object]:
            done = kb(*arguments, "--profile", "harborlight.toml", "--json", env=env, timeout=280)
            assert done.returncode == 0, f"{arguments}: {done.stderr[-2000:]}"
            return json.loads(done.stdout.splitlines()[-1])

        for source in ("youtube", "wiki", "reddit"):
            run(source, "crawl", *(("--workers", "1") if source == "wiki" else ()))
            sorted_out = run(source, "filter")
            assert sorted_out["kept"] > 0, source
            run(source, "export")
        found = run("pairs")
        assert found["pairs"] > 0
        run("release")
        run("report")

    def ask(sql: str) -> list[dict[str, object]]:
        return json.loads(kb("query", sql, "--format", "json").stdout)

    topics = {
        row["topic_evidence"]
        for row in ask("SELECT DISTINCT topic_evidence FROM release.youtube_videos")
    }
    assert topics == {"game_label"}
    off_topic = ask("SELECT count(*) AS n FROM clean.youtube_rejected WHERE stage = 'topic'")
    assert off_topic[0]["n"] >= 30
    assert {row["keyword"] for row in ask("SELECT DISTINCT keyword FROM release.pairs")} <= {
        "River",
        "Harbour",
        "Bridge",
        "Village",
        "Torch",
        "Wolf",
    }
    assert ask("SELECT max(clip_end_s - clip_start_s) <= 6.001 AS ok FROM release.pairs")[0]["ok"]
    assert ask("SELECT min(score) >= 2000 AS ok FROM release.reddit_posts")[0]["ok"]
    card = (tmp_path / "data" / "release" / "youtube" / "README.md").read_text()
    assert "Harborlight" in card
    assert "Minecraft" not in card
    assert any((tmp_path / "data" / "report").iterdir())
