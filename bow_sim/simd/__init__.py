"""Eight cells at once: explicit SIMD for Numba, and where compiled code is stored.

jit         Numba's decorators, for every compiled function
options     options of Numba that several modules share
parts       functions that only compiled functions call: compiled once, with the whole
code_cache  where compiled code is stored, and a message while it is compiled
lane_types  the types of eight lanes, as LLVM knows them
lanes       eight lanes as one value in compiled code
signs       the sign of one value given to another
steps       eight lanes that are eight steps of one number
elementary  exp, log, cosine and sine with the same bits on every machine
rows        convolution and transposition of rows of eight lanes
products    sums of products of rows with earlier rows, for several lags at once
columns     transposition of eight rows of samples, and prefetching
bits        comparisons of many samples at once, as bits
"""
