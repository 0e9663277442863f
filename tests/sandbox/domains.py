"""Three domains of different kinds, small: a craft, a science, a game that is not Minecraft."""

import re
from pathlib import Path

from kb.sandbox.youtube.cases import Video
from kb.sandbox.youtube.catalogue import Catalogue

BREAD = """\
name = "bread"
title = "Bread Baking"
[youtube]
keywords = ["bread baking", "sourdough bread", "baguette recipe"]
topic_keywords = ["bread", "sourdough"]
category_ids = [26, 10]
[wiki]
url = "https://bread.wiki"
[reddit]
subreddit = "Breadit"
[pairs]
keyword_files = ["keywords.tsv"]
[toxicity.thresholds]
youtube = 0.5
reddit = 0.5
[release]
contact = "https://bread.wiki/about"
[[release.creators]]
name = "Bread data group"
"""
STARS = """\
name = "astronomy"
title = "Astronomy"
[youtube]
keywords = ["astronomy"]
category_ids = [27, 28]
min_views = 5_000
min_duration_s = 300
language = "de"
[wiki]
url = "https://stars.wiki"
[wiki.markup]
sprite = ".icon"
animation = ".turning"
animation_active = "turning-now"
recipe = ".made"
slot = "span.place"
slot_output = ".outcome"
quantity = ".how-many"
regions = { infobox = ".about" }
[reddit]
subreddit = "astronomy"
min_score = 50
[pairs]
min_clip_s = 4
max_clip_s = 6
keyword_files = ["keywords.tsv"]
"""
FARM = """\
name = "valley"
title = "Stardew Valley"
[youtube]
keywords = ["Stardew Valley", "Stardew Valley Guide"]
topic_keywords = ["Stardew"]
game_ids = ["UC0123456789abcdefghijkl"]
category_ids = [20]
[wiki]
url = "https://valley.wiki"
[reddit]
subreddit = "StardewValley"
[pairs]
keyword_files = ["keywords.tsv"]
"""
_LISTS = {
    "bread": "Sourdough Starter,Banneton,Dutch Oven,Autolyse,Bulk Fermentation,Baguette,Focaccia"
    ",Rye Flour,Levain,Poolish,Brioche,Stretch and Fold,Windowpane Test,Crumb:near",
    "astronomy": "Black Hole,Neutron Star,Andromeda Galaxy,Redshift,Parallax,Supernova,Exoplanet"
    ",Red Giant,Cepheid,Nebula,Quasar,Light Year,Telescope,Star:near,Moon:near",
    "valley": "Parsnip,Junimo,Iridium Sprinkler,Ancient Fruit,Skull Cavern,Prismatic Shard"
    ",Community Center,Hardwood,Truffle Oil,Greenhouse,Mayor Lewis,Starfruit,Kale,Fence:near",
}
PROFILES = {"bread": BREAD, "astronomy": STARS, "valley": FARM}
# Words of Minecraft and of its recorded wiki, and of games at all. `player.` and `player_` are
# parts of names of fields.
MINECRAFT = re.compile(
    r"(?i)minecraft|creeper|zombie|pickaxe|redstone|enderman"
    r"|brinewick|saltstone|harbour|harborlight"
)
GAMES = re.compile(r"(?i)\bgam(?:e|es|ing|ers?)\b(?!_)|\bplayers?\b(?![._])|\bmobs?\b")


def written(name: str, place: Path) -> Path:
    """The profile of that name with its list, in a folder of its own."""
    folder = place / name
    folder.mkdir()
    rows = [(*word.split(":"), "")[:2] for word in _LISTS[name].split(",")]
    lines = [f"{word}\tthing\t{rule}\t\n" for word, rule in rows]
    (folder / "keywords.tsv").write_text("keyword\tkind\trule\tforms\n" + "".join(lines))
    (folder / "profile.toml").write_text(PROFILES[name])
    return folder / "profile.toml"


def of_case(tube: Catalogue, name: str) -> list[Video]:
    """The videos of a case."""
    return [video for video in tube.videos.values() if video.case.name == name]
