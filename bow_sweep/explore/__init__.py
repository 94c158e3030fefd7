"""The page in the browser, `bow explore`: maps of runs, and one cell seen and heard.

layers   what a map can show: values, colours, legends
pairs    two runs: the nearest cell, the same plane, different settings
samples  what the page shows of a chosen cell
packed   the last periods of every cell, small
plots    the figures of the page
page     the page as a Bokeh document
served   the page on loopback
saved    the page as one file
browser  the user's browser
"""
