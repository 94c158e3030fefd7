"""What is to be simulated: a sweep, its presets, and the rounds of an adaptive one.

sweep     a sweep: which cells, in which blocks, with which parameters
adaptive  which cells to simulate next, and what the others would say
"""
