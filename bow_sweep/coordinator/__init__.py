"""Sends the blocks of a sweep to simulators until every block is done or given up.

session            the coordinator as a state machine: events in, instructions out
session_events     its events and instructions
active_run         the run in progress
answers            receipts and verdicts as events of the ledger
simulator_pool     which simulators are ready, and which blocks each of them holds
consumers          the one recorder and the one classifier of a run
closing            when a closing run can be finished
messages           plan, block, map, progress and result of a run
goals              goals that wait for recorder and classifier
choice             a cell that is chosen while a sweep runs: which one, and its waveform
cell_chooser       its service and topics
diagnostics        the state of the graph as diagnostics
standard_messages  map and health for standard ROS tools
results            the files of a finished run beside its bag
painter            its picture, and the process that draws it
bags_of_run        the bags of a run that is to be resumed
resume             resuming a run: ledger and bag are compared and repaired
node               the coordinator node
"""
