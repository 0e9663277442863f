"""The published layout of MineDojo's YouTube file."""

import json
from pathlib import Path

import jsonschema

from kb.export import minedojo

# Written from facts about the published file, not from our code.
PUBLISHED = {
    "type": "array",
    "items": {
        "type": "object",
        "required": ["id", "title", "link", "view_count", "like_count", "duration", "fps"],
        "additionalProperties": False,
        "properties": {
            "id": {"type": "string"},
            "title": {"type": "string"},
            "link": {"type": "string", "pattern": "^https://www.youtube.com/watch"},
            "view_count": {"type": "integer"},
            "like_count": {"type": ["integer", "null"]},
            "duration": {"type": "number"},
            "fps": {"type": ["number", "null"]},
        },
    },
}


def test_youtube_full_json(tmp_path: Path, make_rows, run_at, fill) -> None:
    links = [f"https://www.youtube.com/watch?v={row}" for row in range(50)]
    rows = make_rows(
        "youtube/videos",
        50,
        link=links,
        like_count=[None, *range(49)],
        fps=[None, *[30] * 49],
        title=['a "quoted" ☃', *["b"] * 49],
    )
    fill(tmp_path, "youtube/videos", rows, 4)
    summary = minedojo.youtube(run_at(tmp_path))
    path = tmp_path / "export" / "minedojo" / "youtube_full.json"
    published = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.validate(published, PUBLISHED)
    assert [video["id"] for video in published] == rows["video_id"].to_pylist()
    first = rows.slice(0, 1).to_pylist()[0]
    assert published[0] == {
        "id": first["video_id"],
        "title": 'a "quoted" ☃',
        "link": links[0],
        "view_count": first["view_count"],
        "like_count": None,
        "duration": first["duration_s"],
        "fps": None,
    }
    assert summary["videos"] == 50
    before = path.read_bytes()
    minedojo.youtube(run_at(tmp_path))
    assert path.read_bytes() == before
    assert not (tmp_path / "release").exists()


def test_tutorials_are_those_whose_title_says_so(tmp_path: Path, make_rows, run_at, fill) -> None:
    """MineDojo's YouTubeDataset(full=False) reads youtube_tutorial.json, with the keys of the full
    file.
    """
    titles = [
        "Minecraft Tutorial: a café",
        "How to tame a fox",
        "BEGINNER'S guide",
        "A walk-through",
        "Misguided",
        "I lost it all",
    ]
    links = [f"https://www.youtube.com/watch?v={row}" for row in range(6)]
    fill(tmp_path, "youtube/videos", make_rows("youtube/videos", 6, title=titles, link=links), 2)
    minedojo.youtube(run_at(tmp_path))
    folder = tmp_path / "export" / "minedojo"
    full, some = (
        json.loads((folder / f"youtube_{name}.json").read_text(encoding="ascii"))
        for name in ("full", "tutorial")
    )
    jsonschema.validate(some, PUBLISHED)
    assert some == [video for video in full if video["title"] in titles[:4]]
    assert len(some) == 4
