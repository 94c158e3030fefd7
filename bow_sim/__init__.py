"""One bowed string: parameters in, waveforms out.

The models of Schumacher and Woodhouse, *The transient behaviour of models of bowed-string
motion*, Chaos 5 (1995) 509-523, called "the paper" in this package.

physics            the string and its player
simd               eight cells at once, in compiled code
kernel             the time loop
protocol           what the nodes say to each other
graph              what every process of the graph shares
figures            the paper's figures of one string
atomic_files       files that are replaced atomically
config_files       finds the files of config/
block_request      a block to compute, as the coordinator asks for it
simulator_session  what a simulator knows and does: events in, instructions out
simulator_events   those events and instructions
node               the simulator node
"""
