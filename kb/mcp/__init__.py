"""`kb mcp`: search and tables for agents, over the Model Context Protocol on stdin and stdout.

server            the four tools; `query` runs SQL in a process of its own (kb.query.execute)
search_tool       `search`: ranked answers
documents         `read`: what surrounds one of them; kb.<source>.documents finds its parts
untrusted_text    retrieved text between unforgeable markers, and answers of limited size
"""
