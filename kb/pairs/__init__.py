"""Keyword-matched video-text pairs (MineDojo paper, appendix: video-text pairs).

    keywords   the profile's list: forms, kinds, rules for everyday words
    fold       case, spaces and punctuation evened out, positions kept
    text       transcripts of a batch as one run of bytes, with the times of their cues
    match      whole words, leftmost-longest, everywhere at once
    choose     rules for everyday words, clips, choice by seeded rank
    grow       the text around a match, to a drawn number of CLIP tokens
    index      all of these on one batch of transcripts → rows of pairs/pairs
    build      every batch of clean/youtube/transcripts → pairs/*.parquet
    refill     a released index and one's own transcripts → pairs/*.parquet
    show       hits per keyword with examples, for a person to judge the list

Work is done on whole batches with numpy and Arrow; nothing is looped over words that no match
touches.
"""
