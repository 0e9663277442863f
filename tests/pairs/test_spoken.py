"""The shipped list against sentences as people speak them, in a video that is known to be about the
game: every name is found, and no everyday phrase is.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Pairs
from kb.core.installation import np
from kb.pairs.extract import PairCounts, Tools, make_tools, matches
from kb.pairs.keywords import load
from kb.pairs.transcript_batch import Text
from tests.bench.keyword_coverage import documentation, measured
from tests.conftest import needs
from tests.pairs.conftest import transcripts

needs("numpy", "tokenizers", "lingua", "rensa")
FOLDER = Path(__file__).parents[2] / "data/profiles/minecraft"

NAMED = {
    "so you want to craft a gold pickaxe first": {"Golden Pickaxe"},
    "grab your diamond pick and follow me": {"Diamond Pickaxe"},
    "i only have a wood axe right now": {"Wooden Axe"},
    "my pickaxe is almost broken": {"Pickaxe"},
    "put the armor on before you go": {"Armor"},
    "full netherite armour and we are good": {"Netherite Armor"},
    "that sword does way more damage": {"Sword"},
    "two endermen just took my blocks": {"Enderman", "Block"},
    "there are pigmen everywhere down here": {"Zombified Piglin"},
    "we build a couple of snowmen outside": {"Snow Man"},
    "a skelly shot me off the bridge": {"Skeleton", "Bridge"},
    "those wither skellies drop skulls": {"Wither Skeleton", "Skull"},
    "now we make an iron farm": {"Iron", "Farm"},
    "chop down this tree for some wood": {"Tree", "Wood"},
    "i need more oak planks": {"Oak Planks"},
    "smelt the gold in the furnace": {"Smelting", "Gold", "Furnace"},
    "the portal is lit let us go to the nether": {"Portal", "The Nether"},
    "we are at the end portal now": {"End Portal"},
    "step through the nether portal": {"Nether Portal"},
    "kill the ender dragon in the end city": {"Ender Dragon", "End City"},
    "strip mining for diamonds at night": {"Strip Mine", "Diamond"},
    "write down the coordinates of the village": {"Coordinates", "Village"},
    "my inventory is full of cobble": {"Inventory", "Cobblestone"},
    "put a hopper under the chest": {"Hopper", "Chest"},
    "lava is dripping through the dripstone": {"Lava", "Dripstone"},
    "wool from the sheep makes a bed": {"Wool", "Sheep", "Bed"},
    "eat the gapple before the fight": {"Golden Apple"},
    "he has a god apple in there": {"Enchanted Golden Apple"},
    "drink the fire res now": {"Fire Resistance"},
    "a deep slate diamond ore": {"Deepslate Diamond Ore"},
    "the mine cart goes down the mine shaft": {"Minecart", "Mineshaft"},
    "watch out for the skulk sensor": {"Sculk Sensor"},
    "powdered snow will freeze you": {"Powder Snow"},
    "put the cactuses on the sand": {"Cactus", "Sand"},
    "a baby zombie on a chicken jockey": {"Baby Zombie", "Chicken Jockey"},
    "the golem gave a flower to the villager": {"Golem", "Flower", "Villager"},
    "we found a geode with amethyst": {"Geode", "Amethyst"},
    "the sulfur cube lives in the sulfur caves": {"Sulfur Cube", "Sulfur Caves"},
    "a polished cinnabar slab looks nice here": {"Polished Cinnabar Slab"},
    "play pigstep on the jukebox": {"Music Disc Pigstep", "Jukebox"},
    "he popped two totems and drank a splash pot": {"Totem", "Potion"},
    "shoot a firework through the trap door": {"Firework", "Trapdoor"},
    "cook the pork chops on a camp fire": {"Porkchop"},
    "froglights and cobble stone walls": {"Froglight", "Cobblestone Wall"},
    "the ender men are at my e chest": {"Enderman", "Ender Chest"},
}
TRAPS = (
    "log in to the server before we start",
    "i logged off and she will log out too",
    "that is the end of the episode",
    "at the end i will tell you who won",
    "in the end it does not matter",
    "stick around and stick to the plan",
    "let us stick together you guys",
    "punch that like button for me",
    "what the hell was that",
    "this seed is amazing by the way",
    "that was a giant mistake",
    "he was fast as light with that speed",
    "turn your head and look at the sign",
    "save your power for the boss",
    "we used to play bed wars and block wars",
    "she made me walk the plank",
    "watch snow white with your kids",
    "i had an egg and some fish for lunch",
    "based on that my cat is asleep",
    "it is chest day for cookie monster",
)

# What counts in a video about the game and means nothing elsewhere.
ELSEWHERE = (
    "it is like talking to a brick wall",
    "they walked the red carpet tonight",
    "that is such bad luck",
    "quick charge your phone before we go",
    "we had raw fish and a baked potato",
    "a totem pole stands on the hill",
    "the fireworks after the game were great",
)


@pytest.fixture(scope="module")
def tools() -> Tools:
    profile = load_profile("minecraft")
    return make_tools(profile.section(Pairs), 0, load(profile))


def found(tools: Tools, sentence: str, *, known: bool) -> set[str]:
    text = Text(transcripts(("v", "asr", [(0, 9, sentence)])), known=np.array([known]))
    return {
        tools.keywords.every[one].name
        for one in matches(text, tools.keywords, PairCounts()).keyword
    }


@pytest.mark.parametrize("sentence", NAMED)
def test_every_name_is_found(tools: Tools, sentence: str) -> None:
    assert found(tools, sentence, known=True) == NAMED[sentence]


@pytest.mark.parametrize("sentence", TRAPS)
def test_no_everyday_phrase_is_a_name(tools: Tools, sentence: str) -> None:
    assert found(tools, sentence, known=True) == set()


@pytest.mark.parametrize("sentence", ELSEWHERE)
def test_everyday_phrases_are_no_names_where_the_topic_is_unknown(
    tools: Tools, sentence: str
) -> None:
    assert found(tools, sentence, known=False) == set()


def test_idioms_are_no_names(tools: Tools) -> None:
    """Counted are those that no rule was made from."""
    text = Path(__file__).with_name("idioms.txt").read_text(encoding="utf-8")
    idioms = [line for line in text.splitlines() if not line.startswith("#")]
    assert len(set(idioms)) == 200
    odd = [line for line in idioms if hashlib.sha256(line.encode()).digest()[-1] % 2]
    taken = {line: names for line in odd if (names := found(tools, line, known=True))}
    assert len(taken) <= 0.05 * len(odd), taken


def test_documentation_has_few_names(tools: Tools) -> None:
    known, unknown = (
        measured(tools, documentation(), None, known=known)["per_1000"] for known in (True, False)
    )
    assert known <= 3
    assert unknown <= 0.1


def test_idioms_take_no_name_with_them(tools: Tools) -> None:
    for sentence, names in {
        "put the water down right here": {"Water"},
        "sharpen it on the grindstone": {"Grindstone"},
        "break the block of ice": {"Block", "Ice"},
        "the wolf is sitting down": {"Wolf"},
        "this will be a chicken farm": {"Chicken", "Farm"},
        "hit the chicken with the axe": {"Chicken", "Axe"},
        "spiders drop string": {"Spider", "String"},
        "three sticks and three pieces of string": {"Stick", "String"},
        "fill a bucket and show them the iron door": {"Bucket", "Iron Door"},
        "a block of gold in the gold ore": {"Block of Gold", "Gold Ore"},
    }.items():
        assert found(tools, sentence, known=True) == names, sentence


def test_topic_words_need_the_topic_and_help_no_other(tools: Tools) -> None:
    assert found(tools, "put the sword in the box", known=False) == set()
    assert found(tools, "put the sword on the hopper", known=False) == {"Sword", "Hopper"}
    assert found(tools, "an egg for your sword", known=True) == {"Sword"}


def test_the_generator_refuses_a_rule_without_a_row(tmp_path: Path) -> None:
    """With no version's names nearly every rule is for nothing."""
    script = FOLDER / "make_keywords.py"
    text = script.read_text(encoding="utf-8")
    versions = re.findall(r'"(\d+\.[\d.]+)"', text)
    paths = {edition: {one: {} for one in versions} for edition in ("pc", "bedrock")}
    (tmp_path / "dataPaths.json").write_text(json.dumps(paths))
    done = subprocess.run(
        [sys.executable, script, tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith("a rule but no row have: absorption, air,")
    assert "pickaxe" not in done.stderr
    assert done.stdout == ""
