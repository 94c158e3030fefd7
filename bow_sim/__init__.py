"""One bowed string: parameters in, waveforms out.

The models of Schumacher and Woodhouse, *The transient behaviour of models of bowed-string
motion*, Chaos 5 (1995) 509-523, called "the paper" in this package.
"""
