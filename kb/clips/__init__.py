"""Clips of pairs out of the user's own video files. Nothing here downloads a video.

frames        the frames that a film shows at given times
film_lookup   which file is the film of a video
clip_sources  the clips of films and shards; all those of a film in one pass
clip_files    webdataset shards, NumPy archives
build         pairs and files → shards, and why a pair has no clip
"""
