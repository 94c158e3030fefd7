"""What every process of the graph shares: its node, its environment, its shared memory.

node_base     the base class of all nodes: quality of service, health, plans
node_process  one node as a process, from its start until Ctrl-C
leaving       the end of a process: leaving DDS, within bounds
run_log       what a node says of a run in its log
outbox        messages that must all be published, in order, also while a subscriber hangs
serialized    messages in CDR that are published from where they are
inbox         messages of a topic that are taken all at once, when the node wants them
discovery     on which machines nodes find each other: this one, unless the user names more
exposure      whether a network would open the graph to the whole internet
diagnosis     what may keep nodes from receiving each other's messages
environment   what a process inherits from its caller: files, signals, variables
imports       of large libraries, without what nothing here needs
scheduling    how processors are divided among processes that pass large messages on
parent        the end of a child process with its parent
process_stat  what the kernel reports of a process
shm_files     files in /dev/shm that a killed process leaves
shm_notes     notes on the shared memory of nodes that have no supervisor
"""
