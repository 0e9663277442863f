"""Folders that yt-dlp filled, in place of requests.

importer    folders → raw answers, by the names of files
info        *.info.json: what is kept of it, and its rows
subtitles   .vtt, .srv3 and .json3 → cues
tracks      which track of a video is its transcript, and of what kind it is
"""
