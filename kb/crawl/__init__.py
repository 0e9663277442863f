"""The frame of every crawl, refresh, import and purge: what is the same for all sources, once.

    source     what a source says of itself: phases, discovery, fetching, what an answer means
    session    lock, identity, frontier, recorder and tombstones of a data root, in this order
    loop       the phases until nothing is left or something stops: limit, wait, signals, failures
    job        a whole run: open, discover, loop, summary; crawl and refresh are this
    purge      keys leave raw answers as the schemas say, and the frontier

A source owns what is its own: what to ask, how to read it, what its errors mean.
"""
