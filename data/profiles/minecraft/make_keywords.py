"""Writes keywords.tsv from the names in the npm package minecraft-data (facts about the game; MIT).

    npm install minecraft-data                (in a folder outside the checkout)
    python make_keywords.py FOLDER/node_modules/minecraft-data/minecraft-data/data > keywords.tsv

Names of all listed versions are taken, so that a video about an old version is matched as well.
Structures and dimensions are not in the package; they stand here, as does the judgement which
names are everyday words.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

VERSIONS = (
    "1.7",
    "1.8",
    "1.9",
    "1.10",
    "1.11",
    "1.12",
    "1.13",
    "1.14",
    "1.15",
    "1.16",
    "1.17",
    "1.18",
    "1.19",
    "1.20",
    "1.21.4",
    "1.21.11",
    "26.1",
)
# In the order in which a kind wins when a name has several.
KINDS = (
    ("entity", "entities"),
    ("block", "blocks"),
    ("item", "items"),
    ("biome", "biomes"),
    ("effect", "effects"),
    ("enchantment", "enchantments"),
)

STRUCTURES = """abandoned mineshaft, ancient city, bastion remnant, buried treasure, desert
pyramid, desert temple, desert well, dungeon, end city, end gateway, end portal, end ship, exit
portal, fossil, igloo, jungle pyramid, jungle temple, mineshaft, mob spawner, nether fortress,
nether fossil, nether portal, ocean monument, ocean ruins, pillager outpost, ruined portal,
shipwreck, spawner, stronghold, swamp hut, trail ruins, trial chamber, village, witch hut, woodland
mansion"""
DIMENSIONS = "Nether, The Nether, The End, Overworld"
SPOKEN = {  # what people say and no version writes
    "Crafting Table": "workbench, crafting bench",
    "Zombified Piglin": "zombie pigman, pig zombie, pigman",
    "Cobblestone": "cobble",
    "Enchanting Table": "enchantment table, enchant table",
    "Eye of Ender": "ender eye",
    "TNT": "t n t",
    "Redstone Dust": "redstone",
    "Lapis Lazuli": "lapis",
    "Glowstone": "glow stone",
    "Netherrack": "nether rack",
    "Bone Meal": "bonemeal",
    "Flint and Steel": "flint n steel",
    "Experience Orb": "xp orb",
    "Elytra": "elytra wings",
    "Bottle o' Enchanting": "xp bottle, experience bottle",
    "Water Bucket": "bucket of water",
    "Lava Bucket": "bucket of lava",
    "Milk Bucket": "bucket of milk",
    "Powder Snow Bucket": "bucket of powder snow",
    "Diamond Pickaxe": "diamond pick",
    "Iron Pickaxe": "iron pick",
}
# Everyday words: alone they say little about the game. "near" wants an unmistakable keyword close
# by; "never" makes no pair.
NEAR = """
absorption, anvil, apple, apples, arrow, bamboo, banner, barrel, barrier, basalt, bat, beach,
beacon, bed, bee, beef, beehive, beetroot, beetroots, bell, birch forest, black dye, blaze,
blindness, blue dye, boat, bogged, bone, book, bookshelf, boots, bow, bowl, bread, breeze, brick,
bricks, brown dye, brush, bucket, bundle, buried treasure, bush, button, cactus, cake, camel,
campfire, candle, carpet, carrot, carrots, cat, cauldron, chain, charcoal, cherry grove, chest,
chest boat, chicken, clay, clock, clownfish, coal, cocoa, cocoa beans, cod, cold ocean, compass,
concrete, cookie, copper, cornflower, cow, creaking, crossbow, dandelion, darkness, deep ocean,
desert, diamond, dirt, dispenser, dolphin, donkey, door, dragon, dropper, drowned, dungeon, dye,
efficiency, egg, eggs, emerald, farmland, feather, fence, fern, fireball, fireworks, fish, fishing
bobber, fishing rod, flame, flint, flower, flower pot, forest, fortune, fossil, fox, frog, frozen
ocean, frozen river, furnace, giant, glass, glass bottle, glow, glowing, goat, gold, gold block,
granite, grass, gravel, grove, guardian, haste, hay, health boost, hell, helmet, honey, hopper,
horse, hunger, husk, ice, ice spikes, igloo, infested, instant damage, instant health,
invisibility, iron, iron bars, iron door, item frame, jigsaw, jukebox, jungle, kelp, ladder, lamp,
lantern, lava, lead, leather, leaves, lectern, lever, levitation, lightning, lilac, lily pad,
llama, log, loom, looting, loyalty, lunge, lure, mace, magma, mannequin, meadow, melon, mending,
milk, mob, monster, moss, mountains, mud, mule, mushroom, mutton, name tag, nausea, nautilus, night
vision, oak, oak tree, observer, ocean, painting, panda, paper, parched, parrot, peony, phantom,
piercing, pig, piston, plains, planks, poison, poppy, portal, potato, potatoes, potion, protection,
pufferfish, pumpkin, punch, quartz, rabbit, raid, rail, rails, regeneration, repeater, resistance,
respiration, riptide, river, rose, saddle, salmon, sand, sandstone, sapling, saturation, savanna,
scaffolding, seagrass, seeds, sharpness, shears, sheep, shield, shipwreck, shrub, skull, slab,
slime, slowness, smite, smoker, sniffer, snow, snowball, snowy beach, spider, sponge, spruce,
spyglass, squid, stairs, steak, stick, stone, stony shore, stray, strength, strider, string,
stronghold, sugar, sugar cane, sunflower, swamp, sword, terracotta, the end, thorns, torch, totem,
trap, tree, trident, tripwire, tropical fish, turtle, vault, vex, village, villager, vine, vines,
void, wall, warden, warm ocean, water, weakness, weaving, wheat, windswept hills, witch, wither,
wolf, wood, wooden button, wooden door, wool
"""
NEVER = """air, breach, corner, data, density, end, fire, gate, head, infinity, item, light, load,
luck, map, marker, path, player, power, rain, save, sign, spawn, speed, target, unluck"""
SKIP = re.compile(
    r"^(?:tile|item|block)\.|%|\(|^minecraft|unused|^null$|^unknown|spawn egg$|^potted "
    r"|smithing template|pottery sherd|banner pattern$|^map \d|void$|^\W*$| wall banner$|text"
    " display|interaction|entity$|^cauldront$|^xp ?orb$|rideable|^primed |signal$|texture|facing",
    re.IGNORECASE,
)


def words(text: str) -> set[str]:
    """Names of a comma-separated list."""
    return {name.strip() for name in text.replace("\n", " ").split(",")}


def main(folder: Path) -> None:
    """Print the list."""
    paths = json.loads((folder / "dataPaths.json").read_text())["pc"]
    kinds: dict[str, str] = {}
    shown: dict[str, str] = {}

    def add(name: str, kind: str) -> None:
        name = " ".join(
            re.sub(
                r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name.replace("_", " ")
            ).split()
        )
        if 2 < len(name) < 40 and not SKIP.search(name):
            kinds.setdefault(name.casefold(), kind)
            shown[name.casefold()] = name[:1].upper() + name[1:]

    for kind, table in KINDS:
        for version in VERSIONS:
            place = paths[version].get(table)
            if place:
                for one in json.loads((folder / place / f"{table}.json").read_text()):
                    add(one.get("displayName") or one["name"], kind)
                    for other in one.get("variations", []) if kind != "entity" else []:
                        add(other["displayName"], kind)
    for name in sorted(words(STRUCTURES)):
        add(name.title(), "structure")
    for name in sorted(words(DIMENSIONS)):
        add(name, "dimension")
    print(
        "# Names of the game, made by make_keywords.py from minecraft-data; structures,"
        " dimensions, spoken forms and rules by hand."
    )
    print(
        "# A rule is for everyday words: near = counts when an unmistakable keyword is"
        " close, never = counted, but makes no pair."
    )
    print("keyword\tkind\trule\tforms")
    order = [kind for kind, _ in KINDS] + ["structure", "dimension"]
    near, never = words(NEAR), words(NEVER)
    spoken = {name.casefold(): forms for name, forms in SPOKEN.items()}
    for key in sorted(kinds, key=lambda one: (order.index(kinds[one]), one)):
        rule = "never" if key in never else "near" if key in near else ""
        print("\t".join((shown[key], kinds[key], rule, spoken.get(key, ""))).rstrip())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
