"""`kb explore`: web pages on this machine over a data root or a downloaded release. Only reads."""
