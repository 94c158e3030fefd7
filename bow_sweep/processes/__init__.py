"""The processes of a graph on this machine: started, watched, restarted, stopped.

roles            the module of each role
fork             child processes: copies of this one, and commands
interrupts       Ctrl-C and SIGTERM, noted and checked for
shm_cleaner      removes what dead processes leave in shared memory
supervisor       starts, restarts and stops the processes of a graph
waiting          which processes are waited for, and when that is too long
supervisor_node  the node beside the supervisor
progress         how a sweep shows on a terminal
new_directory    the directory of a new run
run_graph        a graph from its first process to the finished run directory
replay_graph     judges a bag through DDS
"""
