"""How well the clip of a pair shows what its text says, by a CLIP model and films of the user's.

models.py   checkpoints of four formats as one model: frames and texts to embeddings
build.py    `kb pairs score`: a score for each pair of a film's video; all films, in parts that a
            stopped run does not make again; what people's judgements say of the scores
"""
