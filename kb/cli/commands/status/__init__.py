"""`kb status`: what a data root holds, how old it is, and what to do next."""
