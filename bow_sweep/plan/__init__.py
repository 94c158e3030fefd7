"""What is to be simulated: a sweep, its presets, and the rounds of an adaptive sweep.

sweep     a sweep: which cells, in which blocks, with which parameters
axes      the axes of a map from settings: what is not given comes from the parameter
remedies  what would do where two parameters cannot make a plane
presets   named sweeps in config/presets
preset_files  preset files of a user, and their JSON Schema
adaptive  which cells to simulate next, and how the others are predicted
"""
