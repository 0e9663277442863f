"""`kb explore`: web pages on this machine over a data root or a downloaded release. Only reads.

app           routes, security headers and error pages
server        uvicorn on 127.0.0.1
search        search, and what surrounds an answer
rows          kept, rejected, failed and pending rows, 50 on a page
funnel        how many rows each stage left over
thresholds    what another threshold would keep; threshold_stages, threshold_rows, histogram
pairs         video-text pairs of a keyword
tables        a connection over a few tables, for one question
"""
