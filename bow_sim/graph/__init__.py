"""What every process of the graph shares: its node, its environment, its shared memory.

node_base    the base class of all nodes: quality of service, health, start and end
discovery    how far a graph reaches: this machine unless the user says more
diagnosis    what may keep nodes from hearing each other
environment  what a process takes over from its caller: files, signals, variables
process_stat what the kernel reports of a process
shm_files    files in /dev/shm that a killed process leaves
shm_notes    what a node without a supervisor notes for its successor to remove
"""
