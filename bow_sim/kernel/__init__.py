"""The time loop: parameters of a block of cells in, bridge force and stick/slip out.

block        blocks of cells, computed five periods at a time
time_loop    the compiled loop over samples, eight cells at a time
eight_steps  eight whole steps of the time loop, where there is AVX-512
arriving     what arrives at the bow from one side, some steps at once
rings        where the time loop finds rows of rings and of gestures
windows      the taps of cells that differ, as lanes
order        which cell is in which lane
few_cells    the compiled loop for a few cells, and eight steps of each at a time
ahead        few cells, some chunks at a time
body         modes of the body at the bridge, for the loop
hair         the bow hair, for the loop
arguments    its arguments: named tuples of arrays
tangent      the linearised motion beside a real one
sources      the sources that decide the waveforms, and their hash
fingerprint  what a machine computes for a sweep, as hashes
precompile   compiles and caches the kernels
"""
