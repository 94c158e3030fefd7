"""What the nodes say to each other, and what it means: the contract of docs/DESIGN.md. No ROS, no clock.

messages      the fields of every message
cdr           messages as CDR bytes and back
identity      new names for runs and nodes
sweep_spec    the written form of a sweep
blocks        which cells are in which block
limits        how large a sweep may be
authority     whose plan a node obeys
neighbours    who is on the graph, and whose messages arrive where
flow_control  what a simulator has sent and nobody has answered yet
"""
