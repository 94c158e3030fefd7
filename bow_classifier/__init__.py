"""Waveforms in, verdicts out: the automatic recognition of section III.B of Schumacher & Woodhouse (1995).

features           what is measured on a waveform
verdict            what the features together say
chunk_pass         all features over the cells of a block, in one pass
block_classifier   the chunks of one block in order, with the state between them
task               what the classifier must know of a sweep
stream             its part of the contract: stream messages in, verdict messages out
precompile         compiles and caches the tests
node               the classifier node
"""
