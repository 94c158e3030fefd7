"""The string and its player: parameters, reflection functions, friction, gestures, linear modes.

errors           the error of a parameter that cannot be
parameters       one simulation as flat, typed data; models, gestures and friction laws by name
reflection       the reflection functions of each model of the hierarchy
reflection_text  a reflection function as data, as text and as a file
number_files     text files with numbers, as other programs write them
friction         the friction curve, its hysteresis, and the compiled law
gesture          how bow force and bow speed start
cells            many cells that differ in a few parameters, as arrays
modes            impulse response, mode frequencies and Q factors
motion           when a string slips, and from when on once a period
"""
