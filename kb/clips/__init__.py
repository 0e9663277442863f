"""Clips of pairs out of the user's own video files. Nothing here downloads a video.

frames        the frames that a film shows at given times
clip_sources  where the file of a video is; all its clips in one pass
clip_files    webdataset shards, NumPy archives
build         pairs and files → shards, and why a pair has no clip
"""
