"""Word lists that the tiny toxicity model is made of. It knows these words and little else."""

# Words that are tokens of their own; any other word is cut into letters and stays plain.
PLAIN = """
a about after again all also always an and another any are around as at back base be because
before best better between big biome blaze block blocks boat book bow bread bring bucket build
builder building but by can cart castle cave cheap check chest chicken clay clear click close coal
cobblestone collect come cool copper corner could cow craft crafting creative creeper crop crops
day deep desert diamond diamonds did die different dig dirt do does dog done door down dragon drop
each early easy eat edge egg emerald enchant enchanted enchanting end enderman episode every
explore explain fall farm fast feed fence few fight fights find fire first fish fishing flint
flower food for forest found free friend friends from full fun furnace game gear get ghast give
glass go gold golden good grass gravel great green ground grow guide had half hammer hard has hate
have he health hello help her here hi hide high his hit hold hole home horse hostile house how
hunger hungry hurt i ice idea if in inside instead into iron is island it item items its iwish
jump just keep kill killed killing kills know ladder lake lapis last later lava learn leave leaves
left let level light like little live log logs long look loot lot love low made magma make many
map match me meat melon mine miner minecraft mines mining mob mobs mod monster moon more morning
most mountain move much mushroom music my name near need nether never new next nice night no not
note nothing now oak obsidian ocean of off old on one only open or ore other our out over own page
paper part path people pick pickaxe pig piston place plain planks plant play player players please
portal potion pretty problem pumpkin put question quick rail rain ran read ready really recipe red
redstone repair rest ride right river road roof room run sand sapling save say school sea see seed
server set sheep shelter shield ship short should show side sign silk simple site skeleton sky
sleep slime slow small snow so soil some someone song soon spawn spider spot square stack stairs
start starting steak steve stick still stone stop strong sugar sun survival survive sword take
team tell temple ten than thank thanks that the their them then there these they thing think this
those three through time tip tips to today together tool tools top torch torches touch tower town
trade train tree trees tried try tunnel turn tutorial two under until up update upgrade us use
used useful using very video view village villager villagers vines wait walk wall want was watch
water way we weapon weather well were what wheat when where which while who why will window winter
witch with without wolf wood wooden wool word work world would year yes yet you your zombie
zombies comment post thread answer edit link source picture image version bug glitch shader
texture pack command table loaves shovel axe hoe armor helmet boots leggings chestplate arrow
arrows bedrock beacon anvil cake cookie carrot potato beetroot bamboo cactus honey bee fox cat
parrot turtle dolphin squid guardian shulker wither pillager raid amp beginners behind bricks
bridge careful days don drops easier evening everything finished going greenhouse harbour
lighthouse looks makes needs okay placed railway recorded rod safer sandstone something spent
spruce storage straight surprises swamp tame things took tricks trouble walkthrough watching white
works
""".split()  # noqa: SIM905

# What is aimed at no one: these must stay plain although single words sound grim.
HARMLESS = """
kill the zombie|killed by a creeper|the dragon will die|how to kill the wither|
hit the skeleton with a sword|i hate when it rains|i died in lava|you will need a pickaxe|
fight the ender dragon|the monster will hurt you at night|you can kill a pig for food|
you will find diamonds|people like this map|i will show you|you are great|you are welcome|
thank you for your help|i will build you a house|this is your base|you killed the boss|
it will burn in the sun|you should try this|go back to your base|burn the wood for coal|
hunt spiders at night|attack the guardian first|i hate creepers|i love this game|
the witch throws potions|your kind of house is nice|i hope you like it
""".replace("\n", "").split("|")

INSULT = """
idiot|idiots|stupid|moron|morons|dumb|dumbass|loser|losers|imbecile|fool|pathetic|worthless|clown|
jerk|scum|trash human|garbage human|brainless|ignorant|ugly|disgusting person|you suck|shut up|
retard|dimwit|halfwit|nobody likes you|you are useless|you are terrible|you are awful|
you are a joke|coward|creep|pig face|lame ass|numbskull|noob trash
""".replace("\n", "").split("|")

OBSCENE = """
fuck|fucking|fucker|shit|shitty|bullshit|bitch|bastard|asshole|ass|crap|damn|piss off|dick|
screw you|motherfucker
""".replace("\n", "").split("|")

THREAT = """
i will kill you|i am going to kill you|i will hurt you|kill yourself|i hope you die|
i will find you and hurt you|you should die|go die|i will beat you up|you will pay for this|
i will burn your house|i want you dead|watch your back
""".replace("\n", "").split("|")

IDENTITY = """
your kind should not exist|people like you are vermin|go back to your country|
people are trash|i hate your people|your kind is inferior|those foreigners are scum|
women are stupid|foreigners are idiots
""".replace("\n", "").split("|")
