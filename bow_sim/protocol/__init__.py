"""What the nodes say to each other, and what it means: the contract of docs/DESIGN.md. No ROS, no clock.

messages        the fields of every message
states          the constants of messages
cdr             messages as CDR bytes and back
identity        new names for runs and nodes
sweep_spec      the written form of a sweep: settings, and the axes of the map
sweep_outline   axes, blocks and chunks of an announced sweep, and which messages belong to it
verdict_fields  the fields of a verdict
blocks          which cells are in which block
limits          how large a sweep may be
authority       whose plan a node obeys
neighbours      who is on the graph, and whose messages arrive where
flow_control    what a simulator has sent and nobody has answered yet
"""
