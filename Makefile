# The front door. Each target calls the `kb` command of the same name; options go in ARGS="--limit 100".
# .ci/kb takes exit code 3 (stopped early, passes with time) for success, so that targets can be chained.
# Works from any folder (make -f DIR/Makefile, make -C DIR); .env and data are those of the working folder.
ARGS ?=
HERE := $(dir $(lastword $(MAKEFILE_LIST)))
# `exec`, so that no shell stands between make and kb: it would end at SIGTERM and leave kb running.
KB := exec "$(HERE).ci/kb"

# Kinds of tests that take longest; pyproject.toml says what they are.
SLOW := crash or dask or mediawiki or slow or wheel

.DEFAULT_GOAL := help
.PHONY: help setup demo build youtube-crawl youtube-filter youtube-export wiki-crawl wiki-filter wiki-export \
	reddit-crawl reddit-import reddit-filter reddit-export reddit-reconstruct restore \
	models annotate pairs tasks clips label links release report explore index status update merge doctor test test-all test-label chaos lint types bench lock reference

# What is no target: said in one line, before anything is set up.
.DEFAULT:
	@echo "make: there is no target '$@'; make help lists them" >&2; exit 2

help:               ## this list
	@sed -n -e 's/^##@ \(.*\)/\1|/p' -e 's/^\([a-z-]*\):[^#]*## \(.*\)/\1|\2/p' '$(HERE)Makefile' | while IFS='|' read -r n d; do \
	  if [ -n "$$d" ]; then printf '  make %-20s %s\n' "$$n" "$$d"; else printf '\n%s\n' "$$n"; fi; done
setup:              ## make .venv with the locked dependencies, and find a browser; LIGHT=1: without torch and browser
	@"$(HERE).ci/setup"
demo: setup         ## the whole job on invented loopback services: no key, no network, minutes
	@$(KB) demo $(ARGS)
##@ collect
youtube-crawl: setup      ## channels by keyword, uploads, metadata, transcripts, as raw JSON
	@$(KB) youtube crawl $(ARGS)
wiki-crawl: setup         ## wiki pages as a browser shows them
	@$(KB) wiki crawl $(ARGS)
reddit-crawl: setup       ## posts and comment trees through the API
	@$(KB) reddit crawl $(ARGS)
reddit-import: setup      ## monthly archive dumps to raw: make reddit-import DUMPS="a.zst b.zst"
	@$(KB) reddit import $(DUMPS) $(ARGS)
##@ build
build: setup              ## what is out of date: filters, exports, pairs, tasks, links, index, report, release
	@$(KB) build $(ARGS)
youtube-filter: setup     ## raw answers to clean/youtube, with a reason for every video left out
	@$(KB) youtube filter $(ARGS)
wiki-filter: setup        ## raw pages to clean/wiki
	@$(KB) wiki filter $(ARGS)
reddit-filter: setup      ## raw posts and comments to clean/reddit
	@$(KB) reddit filter $(ARGS)
youtube-export: setup     ## clean/youtube to release/youtube
	@$(KB) youtube export $(ARGS)
wiki-export: setup        ## clean/wiki to release/wiki
	@$(KB) wiki export $(ARGS)
reddit-export: setup      ## clean/reddit to release/reddit
	@$(KB) reddit export $(ARGS)
annotate: setup           ## toxicity scores for text that has none: make annotate ARGS=youtube
	@$(KB) annotate $(ARGS)
pairs: setup              ## keyword-matched video-text pairs
	@$(KB) pairs $(ARGS)
tasks: setup              ## what videos do by their titles, as prompts
	@$(KB) tasks $(ARGS)
links: setup              ## entities, and where videos, wiki and threads speak of them
	@$(KB) links $(ARGS)
index: setup              ## one local index over everything that is clean, for kb search
	@$(KB) index $(ARGS)
clips: setup              ## training clips out of your own video files: make clips ARGS="--videos DIR"
	@$(KB) clips $(ARGS)
label: setup              ## people judge a sample in Label Studio: make label ARGS="export pairs"
	@$(KB) label $(ARGS)
##@ look
status: setup             ## progress, quota, age of the data, what is left
	@$(KB) status $(ARGS)
explore: setup            ## look at rows, stages and pairs in a browser, on this machine
	@$(KB) explore $(ARGS)
report: setup             ## figures and one HTML page of what was collected
	@$(KB) report $(ARGS)
##@ publish
release: setup            ## checks, metadata and checksums around release/
	@$(KB) release $(ARGS)
restore: setup            ## the content of a downloaded release: make restore ARGS="FOLDER --plan"
	@$(KB) restore $(ARGS)
reddit-reconstruct: setup ## full posts and comments again from released ids, with your own key
	@$(KB) reddit reconstruct $(ARGS)
##@ maintain
update: setup             ## for a timer: crawl what is new, refresh, purge, build
	@$(KB) update $(ARGS)
merge: setup              ## the data roots of several machines in one: make merge ARGS="ROOT ROOT"
	@$(KB) merge $(ARGS)
doctor: setup             ## whether this machine has what a long crawl needs
	@$(KB) doctor $(ARGS)
models: setup             ## the published toxicity checkpoint, verified
	@$(KB) models fetch $(ARGS)
##@ more
test: setup               ## the tests, in a few minutes: all but the slow kinds
	@"$(HERE).ci/test" -m "not bench and not ($(SLOW))" $(ARGS)
# For developers; CONTRIBUTING.md lists them.
test-all: setup           # every test
	@"$(HERE).ci/test" $(ARGS)
test-label: setup         # labels through the real Label Studio, installed in an environment of its own (1 GB)
	@"$(HERE).ci/test-label" $(ARGS)
chaos: setup              # kill every command before each file operation, damage every file: KB_CHAOS_KILLS, SEED, ONLY
	@cd "$(HERE)" && .venv/bin/python -m tests.crash.chaos
lint: setup               # ruff: the linter's rules and the formatter's layout
	@cd "$(HERE)" && .venv/bin/ruff check . && .venv/bin/ruff format --check .
types: setup              # mypy, strict, over kb/ and pipelines/
	@cd "$(HERE)" && .venv/bin/mypy
bench: setup              # the benchmarks, as ratios side by side in one run
	@"$(HERE).ci/bench" $(ARGS)
lock: setup               # resolve .ci/requirements.lock again (for developers)
	@"$(HERE).ci/lock"
reference: setup          # write the reference pages again (for developers)
	@cd "$(HERE)" && .venv/bin/python -m tests.docs.reference
