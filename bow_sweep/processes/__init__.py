"""The processes of a graph on this machine: started, watched, restarted, stopped.

exit_status      exit statuses of the command and of its child processes
roles            the module of each role
fork             child processes: copies of this one, and commands
interrupts       Ctrl-C and SIGTERM, noted and checked for
shm_cleaner      removes the shared-memory files of processes that have exited
supervisor       starts, restarts and stops the processes of a graph
watchdog         which processes make no progress, and when that is too long
observed         what the supervisor knows of its graph
supervisor_node  the node of `bow sweep` itself
launch_arguments reads the arguments of the launch files
progress         the progress of a sweep on stderr
progress_bar     the bar that shows it on a terminal
new_directory    the directory of a run: created, locked, released
start_nodes      the processes of a graph started, with what they share loaded once
run_graph        a graph from its first process to the finished run directory
station_graph    the processes of `bow station`
station_watch    watches them until the run is over
leader           whether the coordinator of a station's run is there
replay_graph     classifies a bag through DDS
"""
