"""Local web page to choose, inspect and convert clips, for people who do not use a terminal.

A server on this machine (`server`) answers the page with functions of the library: `files` lists folders, `clip` reads
clips, `choices` turns the page's form into a job, and `jobs` runs a queue of command lines.
"""
