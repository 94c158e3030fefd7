"""A graph that stays in the background of this machine and runs one sweep after another.

state     the folder of a standing graph: what is in it, and whether the graph is there
process   the process that keeps it: starts the nodes, watches them, stops them
watch     watches its nodes
start     starts and stops that process
turns     whose turn it is among its clients
listener  hears what its nodes say
client    sends it sweeps and waits for them
fits      which commands it can serve
"""
