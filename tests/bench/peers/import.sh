#!/bin/sh
# import.sh DUMP OUT: the lines of one subreddit
zstd -dcq --long=31 "$1" | LC_ALL=C grep -F '"subreddit": "Minecraft"' | zstd -q -3 -o "$2"
