"""`kb mcp`: search and tables for agents, over the Model Context Protocol on stdin and stdout.

server      the four tools as the SDK has them, and when the server ends
found       `search`: ranked answers
around      `read`: what stands around one of them (transcript, page, thread)
asked       `query`: SQL in a process of its own (kb.query.isolated)
about       `about`: what is in here, how fresh, under which licences
places      what names a place: "wiki:14#Taming", or a link
fence       retrieved text between marks that it can't write, and answers that keep their size
"""
