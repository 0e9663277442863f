"""Clips of pairs out of the user's own video files. Nothing here downloads a video.

video_files   where the file of a video is
frames        the frames that a film shows at given times
cut           all clips of a film in one pass
clip_files    webdataset shards, NumPy archives
build         pairs and files → shards, and why a pair has no clip
"""
