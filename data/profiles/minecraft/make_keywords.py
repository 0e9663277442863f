"""Writes keywords.tsv from the names in the npm package minecraft-data (facts about the game; MIT).

    npm install minecraft-data                (in a folder outside the checkout)
    python make_keywords.py FOLDER/node_modules/minecraft-data/minecraft-data/data > keywords.tsv

Names of all listed versions are taken, so that a video about an old version is matched as well, and
of Bedrock what Java's data lacks. What is in no version stands here: structures, dimensions,
families ("pickaxe" beside "Diamond Pickaxe"), spoken forms, and the judgement which names are
everyday words. A rule or form without a row ends the run.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

JAVA = (
    *("1.7", "1.8", "1.9", "1.10", "1.11", "1.12", "1.13", "1.14", "1.15", "1.16", "1.17", "1.18"),
    *("1.19", "1.20", "1.21.4", "1.21.11", "26.1"),
)
BEDROCK = ("1.26.30", "1.26.60")
# Most other names that only Bedrock has are chemical elements, and blocks that nobody can place.
ONLY_BEDROCK = re.compile(
    r"sulfur|cinnabar|poplar|cushion|(concrete|wool) (slab|stairs)$|^chiseled purpur$|^straw bed$"
    r"|^lodestone compass$|^shelf mushroom$|^(ice crystal|icicle|disc press)$",
    re.IGNORECASE,
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

# What no version has as a name, by kind.
BY_HAND = {
    "entity": """
Baby Zombie, Chicken Jockey, Dragon, Golem, Librarian, Spider Jockey, Sulfur Cube
""",
    "block": """
Acacia, Amethyst, Birch, Block, Comparator, Dark Oak, Door, Dripstone, Flower, Froglight, Log,
Magma, Moss, Oak, Ore, Planks, Portal, Pressure Plate, Repeater, Slab, Spruce, Staircase, Stairs,
Tree, Vine, Wall
""",
    "item": """
Armor, Axe, Beef, Boots, Chainmail Armor, Copper, Copper Armor, Debris, Diamond Armor, Diamond
Tools, Explorer Map, Firework, Food, Gold, Golden Armor, Helmet, Hoe, Honey, Ingot, Iron, Iron
Armor, Iron Tools, Leather Armor, Leggings, Chestplate, Meat, Music Disc Bounce, Music Disc
Creator, Music Disc Lava Chicken, Music Disc Otherside, Music Disc Pigstep, Music Disc Precipice,
Music Disc Relic, Music Disc Tears, Netherite, Netherite Armor, Nugget, Ocean Explorer Map, Pearl,
Pickaxe, Porkchop, Quartz, Shovel, Spear, Stone Tools, Sword, Totem, Treasure Map, Trial Explorer
Map, Woodland Explorer Map, Wooden Tools
""",
    "biome": "Biome, Sulfur Caves, Tundra",
    "enchantment": "Enchantment",
    "structure": """
abandoned mineshaft, ancient city, base, bastion, bastion remnant, bridge, buried treasure,
castle, cave, desert pyramid, desert temple, desert well, dungeon, end city, end gateway, end
portal, end ship, exit portal, farm, fortress, fossil, geode, house, igloo, jungle pyramid, jungle
temple, mansion, mineshaft, mob spawner, monument, nether fortress, nether fossil, nether portal,
ocean monument, ocean ruins, outpost, pillager outpost, pyramid, raid, ravine, ruined portal,
shipwreck, spawner, stronghold, sulfur spring, swamp hut, temple, tower, trail ruins, trial
chamber, village, witch hut, woodland mansion
""",
    "dimension": "Nether, The Nether, The End, Overworld",
    "term": "Chunk, Coordinates, Inventory, Recipe, Seed, Spawn, Spawn Point, XP",
    "action": "Brewing, Crafting, Enchanting, Mining, Smelting, Strip Mine",
}
SPOKEN = {  # what people say and no version writes
    "Boat with Chest": "chest boat",
    "Bone Meal": "bonemeal",
    "Bottle o' Enchanting": "xp bottle, experience bottle",
    "Bucket of Sulfur Cube": "sulfur cube bucket",
    "Cactus": "cactuses",
    "Cobblestone": "cobble",
    "Cobweb": "cob web, spider web",
    "Coordinates": "coords, cords",
    "Crafting Table": "workbench, crafting bench, work bench",
    "Elytra": "elytra wings, elitra",
    "Enchanted Golden Apple": "god apple, notch apple",
    "Enchanting Table": "enchantment table, enchant table",
    "Ender Chest": "e chest, echest",
    "Ender Pearl": "e pearl, epearl",
    "Enderman": "ender men",
    "Experience Orb": "xp orb",
    "Explorer Map": "explorer's map",
    "Eye of Ender": "ender eye",
    "Fire Resistance": "fire res",
    "Flint and Steel": "flint n steel",
    "Glowstone": "glow stone",
    "Golden Apple": "gapple",
    "Inventory": "hotbar",
    "Lapis Lazuli": "lapis",
    "Lava Bucket": "bucket of lava",
    "Lead": "leash",
    "Leather Cap": "leather helmet",
    "Leather Pants": "leather leggings",
    "Leather Tunic": "leather chestplate",
    "Milk Bucket": "bucket of milk",
    "Mountains": "mountain",
    "Music Disc Lava Chicken": "lava chicken",
    "Music Disc Otherside": "otherside",
    "Music Disc Pigstep": "pigstep",
    "Nether Fortress": "nether fort",
    "Nether Wart": "wart",
    "Netherrack": "nether rack",
    "Phantom Membrane": "membrane",
    "Potion": "invis pot, strength pot, speed pot, health pot, healing pot, splash pot",
    "Powder Snow": "powdered snow",
    "Powder Snow Bucket": "bucket of powder snow",
    "Redstone Dust": "redstone",
    "Skeleton": "skelly, skellies",
    "Smelting": "smelt, smelted",
    "Spawn Point": "respawn point",
    "Strip Mine": "strip mining",
    "TNT": "t n t",
    "Water Bucket": "bucket of water",
    "Wither Skeleton": "wither skelly, wither skellies",
    "XP": "experience points, exp",
    "Zombified Piglin": "zombie pigman, pig zombie, pigman, pig man, zombie pig man",
}
# What is said in place of a word of a name, in any name that has it: gold pick, Golden Pickaxe.
SAID = {
    "armor": ("armour",),
    "axe": ("ax",),
    "chainmail": ("chain",),
    "chestplate": ("chest plate",),
    "cobblestone": ("cobble stone",),
    "crossbow": ("cross bow",),
    "deepslate": ("deep slate",),
    "golden": ("gold",),
    "grindstone": ("grind stone",),
    "gunpowder": ("gun powder",),
    "minecart": ("mine cart",),
    "mineshaft": ("mine shaft",),
    "pickaxe": ("pick", "pick axe", "pickax", "pick ax"),
    "porkchop": ("pork chop",),
    "sculk": ("skulk",),
    "stonecutter": ("stone cutter",),
    "trapdoor": ("trap door",),
    "wooden": ("wood",),
}
# "At the end portal" is no end, and "the nether portal" is a portal.
THERE = {"end": ("the", "at the", "in the"), "nether": ("the",)}

# Everyday words. `topic` counts in a video that is known to be about the game; `near` wants an
# unmistakable keyword close by, in such a video too; `never` makes no pair.
TOPIC = """
apple, armor, arrow, axe, bad luck, baked potato, bamboo, bastion, beacon, bed, birch, block, blue
egg, boat, bone, book, boots, bow, bread, brewing, brick, brick wall, bricks, bridge, brown egg,
brown mushroom, bucket, bundle, cactus, camel, carpet, carrot, carrots, cauldron, cave, chest,
chicken, chunk, clay, coal, cod, cooked chicken, cooked cod, cooked fish, cooked mutton, cooked
porkchop, cooked rabbit, cooked salmon, coordinates, copper, cow, crafting, dark forest, dead
bush, desert, diamond, dirt, door, drowned, dungeon, dye, efficiency, emerald, enchanting,
enchantment, farm, feather, fence, firework, fishing bobber, fishing rod, flower forest, food,
forest, fortress, fossil, goat, gold, granite, grass, gravel, guardian, helmet, hoe, house, ice,
infinity, inventory, iron, iron chain, jungle, kelp, ladder, lantern, leaf litter, leather,
leggings, lever, lightning bolt, lightning rod, llama, log, loom, mace, magma, meat, mining,
mountains, mule, mushroom, mushroom stew, oak, ocean, ore, pearl, phantom, pig, pink petals,
plains, planks, polar bear, porkchop, portal, potato, potatoes, potion, protection, pufferfish,
pumpkin, pumpkin pie, pyramid, quick charge, rail, ravine, raw beef, raw chicken, raw cod, raw
fish, raw mutton, raw porkchop, raw rabbit, raw salmon, recipe, red mushroom, river, salmon, sand,
savanna, scaffolding, seeds, sheep, shield, shipwreck, short grass, shovel, slab, slime, smelting,
snow, snowball, spawn, spawn point, spear, spider, spruce, stained glass, staircase, stairs,
stick, stone, string, strip mine, sugar, swamp, sweet berries, sword, tall grass, temple, the end,
torch, totem, tower, tree, tropical fish, tundra, turtle egg, turtle shell, village, villager,
wall sign, water, wheat, wildflowers, witch, wolf, wood, xp
"""
NEAR = """
absorption, banner, barrel, barrier, base, bat, beach, bee, beef, bell, blindness, bowl, breeze,
brush, bush, button, cake, candle, castle, cat, chain, clock, cocoa, compass, concrete, cookie,
dandelion, darkness, debris, deep ocean, dolphin, donkey, dragon, egg, fern, fireball, fish, flame,
flower, fortune, fox, frog, glass, glowing, grove, haste, honey, horse, hunger, husk, infested,
invisibility, lead, leaves, librarian, lilac, looting, loyalty, lunge, lure, mannequin, mansion,
meadow, melon, milk, monster, monument, moss, mud, nausea, nautilus, night vision, nugget, outpost,
painting, panda, paper, parched, parrot, peony, piercing, poison, poppy, rabbit, raid, resistance,
respiration, rose bush, saturation, shrub, skull, sponge, squid, steak, stray, strength, sunflower,
thorns, turtle, vault, vine, vines, wall, weakness
"""
NEVER = """
air, breach, corner, data, density, fire, giant, head, hell, item, light, load, luck, map, marker,
player, power, punch, save, seed, sign, speed, target
"""
ALWAYS = """
anvil, furnace, hopper, levitation, mending, mob, observer, regeneration, saddle, sapling, wool
"""  # everyday words that are mostly meant when they are said
# Coloured things that every home has are `topic` as well.
AT_HOME = re.compile(
    "(white|orange|magenta|yellow|lime|pink|gr[ae]y|light gr[ae]y|cyan|purple|blue|light blue|brown"
    "|green|red|black) (bed|candle|carpet|cushion)"
)
SKIP = re.compile(
    r"^(?:tile|item|block)\.|%|\(|^minecraft|unused|^null$|^unknown"
    r"|smithing template|^map \d|^the void$|^\W*$| wall banner$|text"
    r" display|interaction|entity$|^cauldront$|^xp ?orb$|rideable|^primed |signal$|texture|facing"
    r"|^spawn egg$|^banner pattern$",
    re.IGNORECASE,
)
HEAD = """\
# Names of the game, made by make_keywords.py from minecraft-data; families, structures, terms,
# spoken forms and rules by hand.
# A rule is for everyday words: topic = counts in a video that is known to be about the game, near =
# counts when an unmistakable keyword is close, never = counted, but makes no pair.
keyword\tkind\trule\tforms"""


def words(text: str) -> set[str]:
    """Names of a comma-separated list."""
    return {" ".join(name.split()) for name in text.split(",") if name.strip()}


def named(data: Path) -> Iterator[tuple[str, str]]:
    """Every (name, kind) of the listed versions. Data of a version may be that of an older one."""
    paths = json.loads((data / "dataPaths.json").read_text())
    for kind, table in KINDS:
        for edition, versions in (("pc", JAVA), ("bedrock", BEDROCK)):
            for version in versions:
                place = paths[edition][version].get(table)
                if not place or (edition == "bedrock" and table not in ("blocks", "items")):
                    continue
                for one in json.loads((data / place / f"{table}.json").read_text()):
                    name = one.get("displayName") or one["name"]
                    if edition == "pc" or (
                        ONLY_BEDROCK.search(name)
                        and "Double" not in name
                        and "Wall Sign" not in name
                    ):
                        yield name, kind
                    if edition == "pc" and kind != "entity":
                        for other in one.get("variations", []):
                            yield other["displayName"], kind


def said(name: str) -> list[str]:
    """What people say in place of a name, by its words."""
    key = name.casefold()
    own = key.split()
    ways = [(word, *SAID.get(word, ())) for word in own]
    forms = [" ".join(way) for way in product(*ways)]
    if len(own) > 1:
        forms += [f"{way} {form}" for form in forms for way in THERE.get(own[0], ())]
    return [form for form in forms if form not in (key, "pick")]  # which alone says little


def main(data: Path) -> None:
    """Print the list. Raises SystemExit for a rule or a form without a row."""
    kinds: dict[str, str] = {}
    shown: dict[str, str] = {}

    def add(name: str, kind: str) -> None:
        parted = r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"
        name = " ".join(re.sub(parted, " ", name.replace("_", " ")).split())
        if 1 < len(name) < 40 and not SKIP.search(name):
            kinds.setdefault(name.casefold(), kind)
            shown[name.casefold()] = name[:1].upper() + name[1:]

    for name, kind in named(data):
        add(name, kind)
    for kind, names in BY_HAND.items():
        for name in sorted(words(names)):
            add(name.title() if kind == "structure" else name, kind)
    rules: dict[str, str] = {}
    for rule, names in (("topic", TOPIC), ("near", NEAR), ("never", NEVER), ("always", ALWAYS)):
        for name in words(names):
            if rules.setdefault(name, rule) != rule:
                sys.exit(f"{name!r} has the rules {rules[name]} and {rule}")
    spoken = {name.casefold(): forms for name, forms in SPOKEN.items()}
    for what, without in (("rule", rules.keys() - kinds), ("form", spoken.keys() - kinds)):
        if without:
            sys.exit(f"a {what} but no row have: {', '.join(sorted(without))}")
    taken = set(kinds)
    print(HEAD)
    order = [*dict(KINDS), "structure", "dimension", "term", "action"]
    rows = sorted(kinds, key=lambda one: (order.index(kinds[one]), one))
    hand = {key: [form.strip() for form in spoken.get(key, "").split(",") if form] for key in rows}
    taken.update(form for forms in hand.values() for form in forms)
    for key in rows:
        more = [form for form in said(key) if form not in taken]
        taken.update(more)
        forms = ", ".join([*hand[key], *more])
        print(
            "\t".join(
                (
                    shown[key],
                    kinds[key],
                    rules.get(key, "topic" if AT_HOME.fullmatch(key) else ""),
                    forms,
                )
            ).rstrip()
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
