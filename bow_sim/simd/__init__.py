"""Eight cells at once: explicit SIMD for Numba, and where compiled code is kept.

jit         Numba's decorators, for every compiled function
code_cache  where compiled code is kept and read from
lanes       eight lanes as one value in compiled code
rows        convolution and transposition of rows of eight lanes
columns     eight rows of samples as eight columns
"""
