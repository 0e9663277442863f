"""How well the clip of a pair shows what its text says, by a CLIP model and films of the user's.

models.py   checkpoints of four formats as one model: frames and texts to embeddings
films.py    a film and the pairs of its video → a score for each pair
build.py    `kb pairs score`: all films, in parts that a stopped run does not make again, and what
            people's judgements say of the scores
"""
