"""The messages between the nodes and the rules for them: the contract of docs/DESIGN.md. No ROS, no clock.

messages        the fields of every message
states          the constants of messages
cdr             messages as CDR bytes and back
cdr_in_place    messages that are alike but for numbers and arrays, written where they go out
intervals       slip intervals that can be
cdr_readers     functions that read messages of the usual form at once
identity        new identities for runs and nodes
sweep_spec      the written form of a sweep: settings, and the axes of the map
axis_names      which parameters can be the axis of a map
repeats         cells repeated with slightly other bow forces
recording       which streams are recorded
sweep_outline   axes, blocks and chunks of an announced sweep, and which messages belong to it
measured        what the plan of a measured string is
verdict_fields  the fields of a verdict
inspected       which cells have their waveforms shown
blocks          which cells are in which block
limits          how large a sweep may be
authority       whose plan a node obeys
stations        groups of simulators with a recorder and a classifier of their own
neighbours      which nodes are alive, and which topics work
flow_control    the chunks that a simulator has sent and that are not answered yet
"""
