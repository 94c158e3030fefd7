"""A plan in, a map out: sweeps over the player's control space, as a ROS 2 graph or in this process.

plan               what is to be simulated
maps               what a sweep found
run                a run on disk
record             its bag
view               pictures and the dashboard
coordinator        who hands out the blocks
processes          the processes of a graph on this machine
paper              what the paper states, beside what is found
cli                the command `bow`
entry              entry points of the executables
"""
