"""Where the outcome of a gesture changes, and whether small differences between two motions grow.

motions     cells computed and judged at once, with bridge force and slips
boundary    the edges of a map: neighbouring cells of different outcome
parting     where two motions part: deciding step, parting, kind of edge
bisection   edges of a map, bisected in parallel lanes
edges_file  the results as edges.npz and edges.json
picture     the results as a picture
exponent    growth of an infinitesimal change
"""
