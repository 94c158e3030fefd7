"""The string and its player: parameters, reflection functions, friction, gestures, linear modes.

errors           the error for a wrong parameter
exact            elementary functions with the same bits on every machine
parameters       one simulation as flat, typed data; models, gestures and friction laws by name
fields           fields of parameters: meaning, unit, source, range
instruments      real strings, bows and rosins by name, and values in SI units
body             modes of the violin body at the bridge
reflection       the reflection functions of each model of the hierarchy
reflection_text  one reflection function as data, as text and as a file
number_files     text files of numbers that other programs write
friction         friction laws: curve, hysteresis, and the solution of one time step
friction_curve   a friction curve of one's own as text and as a file
thermal          friction that falls with the temperature of the contact
schelleng        Schelleng's limits of bow force
gesture          gestures: bow force and bow speed over time
usual_axes       which values a setting takes along an axis of a map, where only its name is given
kinds            axes whose cells cannot share a block: models, thresholds of the verdicts
applicability    which settings have an effect, and what a user should know of a combination
cells            cells that differ in a few parameters, as arrays
modes            impulse response, mode frequencies and Q factors
motion           slip onsets, and the start of regular motion
"""
