"""Folders that yt-dlp filled, in place of requests, and transcripts of one's own.

importer    folders → raw answers
info        names of files; what is kept of an info.json, and its rows
subtitles   .vtt, .srv3, .json3, .srt and JSON of speech recognition → cues
tracks      which track of a video is its transcript, and of what kind it is
"""
